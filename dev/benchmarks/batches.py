"""What many episodes side by side cost: judging them, and stepping them on several threads."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

import duobench
from dev.benchmarks.environments import (
    PIECE,
    bare_physics,
    controls,
    expert_actions,
    in_pieces,
)
from dev.benchmarks.measure import Measurement, Work, seconds
from duobench.envs.batch_env import BatchEnv
from duobench.envs.sim_env import sim_of

JUDGED = 1024
"""Episodes that are judged at once."""
JUDGEMENT, LONG_JUDGEMENT = 6.0, 12.0
"""Bars of a judgement, in microseconds."""
LONG = ("hinge_chest", "spring_door", "pour_marbles", "join_blocks", "bin_sort")
"""Tasks whose stages ask the most."""
EPISODES, PROCESSES = 64, 16
"""Episodes that are stepped side by side, on threads and in processes."""
STEPS = 15 * PIECE
"""Control steps of each, less than any expert's episode has."""
START = {"layout_seed": 0}
CONTROLS = int(mujoco.mjtState.mjSTATE_CTRL)


def measure_judging(name: str, repeats: int = 20) -> Iterator[Measurement]:
    """Measure a judgement of many episodes at once, and apart from it the copy of contacts.

    Each episode is at another control step of an expert's, so that all of that is in the mean.
    """
    env = duobench.make(name, cameras=False)
    actions = expert_actions(env)
    env.reset(options=START)
    sim = sim_of(env).simulation
    variants, states = dict(sim.variants), []
    for action in actions:
        env.step(action)
        states.append(sim.get_state())
    vector = BatchEnv(duobench.make(name, cameras=False), JUDGED, 1)
    simulations, judge = vector.simulations, vector.judge
    vector.reset(options=START)
    numbers, everywhere = np.arange(JUDGED), np.ones(JUDGED, dtype=bool)
    simulations.load(
        numbers, [variants] * JUDGED, [states[number % len(states)] for number in numbers]
    )

    def judgement() -> None:
        simulations.contacts.update(simulations.centres)
        simulations.forget()
        judge.update(everywhere)

    copied = _shortest(lambda: simulations.copy_contacts(numbers), repeats)
    judged = _shortest(judgement, repeats)
    env.close()
    vector.close()
    yield Measurement(
        what=f"{name}: a judgement, {JUDGED} at once",
        value=judged / JUDGED * 1e6,
        unit="us",
        at_most=LONG_JUDGEMENT if name in LONG else JUDGEMENT,
    )
    yield Measurement(what=f"{name}: its contacts", value=copied / JUDGED * 1e6, unit="us")


def _shortest(work: Callable[[], object], repeats: int) -> float:
    """Seconds of the processor that work takes undisturbed, in this thread."""
    times = []
    for _ in range(repeats):
        start = time.thread_time()
        work()
        times.append(time.thread_time() - start)
    return min(times)


def measure_steps(name: str, repeats: int = 3) -> Iterator[Measurement]:
    """Measure an expert's episode, many times side by side, against the bare engine and processes.

    Bare is `mj_step` in one thread, and MuJoCo's own threads that do nothing else. Where other work
    keeps the processor busy, only time of the processor, of all threads and processes together,
    tells what the machine could do alone: that is the second number.
    """
    env = duobench.make(name, cameras=False)
    actions = expert_actions(env)[:STEPS]
    vectors = [
        duobench.make_vec(name, EPISODES, threads=1),
        duobench.make_vec(name, EPISODES, threads=2),
        duobench.make_vec(name, PROCESSES, "async", {"context": "spawn"}, cameras=False),
    ]
    works = [
        bare_physics(env, actions),
        _engine(env, actions, threads=2),
        *(_work(vector, actions) for vector in vectors),
    ]
    counts = np.array([1, EPISODES, EPISODES, EPISODES, PROCESSES])
    of_clock = np.array(seconds(*works, repeats=repeats)) / counts
    children = [process.pid for process in getattr(vectors[-1], "processes", ())]
    of_processor = np.array([_processor_time(work, children) for work in works]) / counts
    for vector in (*vectors, env):
        vector.close()
    for clock, (bare, engine, one, two, processes) in (("", of_clock), (" (cpu)", of_processor)):
        threads = 1 if clock else 2  # two threads take twice the processor's time a second
        for what, value, least in (
            ("1 thread / bare mj_step", bare / one, 0.85),
            ("2 threads / (2 x bare mj_step)", bare / two / threads, 0.85),
            ("2 threads / engine on 2 threads", engine / two, 0.85),
            ("2 threads / AsyncVectorEnv", processes / two, 1.4),
        ):
            yield Measurement(what=f"{name}: {what}{clock}", value=value, at_least=least)
    speed = len(actions) / of_clock[3]
    yield Measurement(what=f"{name}: control steps, 2 threads", value=speed, unit="/s")


def _processor_time(work: Work, children: Sequence[int]) -> float:
    """Seconds of the processor that work takes in this process and in others, by their ids."""

    def now() -> float:
        fields = [Path(f"/proc/{child}/stat").read_text().rpartition(")")[2] for child in children]
        ticks = sum(int(number) for text in fields for number in text.split()[11:13])
        return time.process_time() + ticks / os.sysconf("SC_CLK_TCK")

    work.prepare()
    start = now()
    for piece in work.pieces:
        piece()
    return now() - start


def _engine(env: gym.Env, actions: NDArray[np.float32], threads: int) -> Work:
    """The motion of all episodes as steps of MuJoCo's threads alone."""
    state, ramps = controls(env, actions)
    batch = Batch(sim_of(env).simulation.model, EPISODES, threads, persistent=True)

    def begin() -> None:
        batch.state[:] = state
        batch.forward(stage=int(mujoco.mjtStage.mjSTAGE_VEL))

    def step(ramp: NDArray[np.float64]) -> None:
        batch.rollout(len(ramp), np.tile(ramp, (EPISODES, 1, 1)), control_spec=CONTROLS, record=())

    return Work(pieces=in_pieces(step, ramps), prepare=begin)


def _work(vector: gym.vector.VectorEnv, actions: NDArray[np.float32]) -> Work:
    several = [np.tile(action, (vector.num_envs, 1)) for action in actions]
    return Work(
        pieces=in_pieces(vector.step, several), prepare=lambda: vector.reset(options=dict(START))
    )
