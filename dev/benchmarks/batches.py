"""What many episodes side by side cost: judging them, and stepping them on several threads."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from functools import partial
from unittest.mock import patch

import gymnasium as gym
import mujoco
import numpy as np
from mujoco.batch import Batch
from mujoco.rollout import rollout as rollout_of_engine
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
from duobench.core.types import SIDES, DuoCommand
from duobench.envs.action_modes import CARTESIAN
from duobench.envs.batch_env import BatchEnv
from duobench.envs.rewards import DENSE
from duobench.envs.sim_env import sim_of
from duobench.evaluation.policies import ExpertPolicy
from duobench.evaluation.rollouts import rollout
from duobench.tasks.stages.progress import Progress
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import ROBOT
from duobench.world.scene.compose import SUBSTEPS
from duobench.world.sim.simulation import STATE, Simulation

JUDGED = 1024
"""Episodes that are judged at once."""
ALONE = 55.0
"""Bar of a judgement of one episode, in microseconds."""
SEEDS = 3
"""Seeds of the episodes that are judged alone."""
JUDGEMENT, LONG_JUDGEMENT = 6.0, 12.0
"""Bars of a judgement, in microseconds."""
LONG = ("hinge_chest", "spring_door", "pour_marbles", "join_blocks", "bin_sort")
"""Tasks whose stages ask the most."""
EPISODES, PROCESSES = 64, 16
"""Episodes that are stepped side by side, on threads and in processes."""
STEPS = 15 * PIECE
"""Control steps of each, less than any expert's episode has."""
START = {"layout_seed": 0}
PHYSICS = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
CONTROLS = int(mujoco.mjtState.mjSTATE_CTRL)


def measure_judging(name: str, repeats: int = 20) -> Iterator[Measurement]:
    """Measure a judgement of one episode, and of many at once, and apart from it their contacts.

    Each of many is at another control step of an expert's, so that all of that is in the mean.
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
        numbers,
        [variants] * JUDGED,
        [states[number % len(states)] for number in numbers],
    )

    def judgement() -> None:
        simulations.contacts.update(simulations.centres)
        simulations.forget()
        judge.update(everywhere)

    def dense_judgement() -> None:
        judgement()
        judge.nearness()

    copied = _shortest(lambda: simulations.copy_contacts(numbers), repeats)
    judged, dense = _shortest(judgement, repeats), _shortest(dense_judgement, repeats)
    env.close()
    vector.close()
    yield Measurement(
        what=f"{name}: a judgement", value=_alone(name) * 1e6, unit="us", at_most=ALONE
    )
    yield Measurement(
        what=f"{name}: a judgement, {JUDGED} at once",
        value=judged / JUDGED * 1e6,
        unit="us",
        at_most=LONG_JUDGEMENT if name in LONG else JUDGEMENT,
    )
    for what, more in (("its contacts", copied), ("how near it is", dense - judged)):
        yield Measurement(what=f"{name}: {what}", value=more / JUDGED * 1e6, unit="us")


def _alone(name: str) -> float:
    """Return the seconds that a judgement of one episode takes while an expert plays it.

    It is `Progress.update` alone, in the time that the processor spends on this thread, on average
    over all control steps of an episode, with the physics between them, after which nothing of it
    is in the processor's caches; the least of the episodes of seeds 0 to 2.
    """
    env = duobench.make(name, cameras=False)
    judge, times, means = Progress.update, list[float](), list[float]()

    def timed(progress: Progress, simulation: Simulation) -> int:
        time.thread_time()  # the clock is in no cache either, and costs several microseconds then
        start = time.thread_time()
        stage = judge(progress, simulation)
        times.append(time.thread_time() - start)
        return stage

    with patch.object(Progress, "update", timed):
        for seed in range(SEEDS):
            times.clear()
            rollout(env, ExpertPolicy(env), seed=seed)
            means.append(statistics.mean(times))
    env.close()
    return min(means)


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

    Bare is `mj_step` or `mujoco.rollout` in one thread, and MuJoCo's own threads that do nothing
    else: where other work keeps the processor busy, only the last tells what two threads could do.
    Processes, of which there are more, then get a larger share of it than threads.
    """
    env = duobench.make(name, cameras=False)
    actions = expert_actions(env)[:STEPS]
    vectors = [
        duobench.make_vec(name, EPISODES, threads=1),
        duobench.make_vec(name, EPISODES, threads=2),
        duobench.make_vec(
            name, PROCESSES, "async", {"context": "spawn"}, cameras=False
        ),
        duobench.make_vec(
            name,
            EPISODES,
            threads=1,
            action_mode=CARTESIAN.name,
            object_state=True,
            reward=DENSE,
        ),
    ]
    motions = actions, actions, actions, _tool_poses(actions)
    works = [
        bare_physics(env, actions),
        _engine(env, actions, threads=2),
        _rollout(env, actions),
        *(
            _work(vector, motion)
            for vector, motion in zip(vectors, motions, strict=True)
        ),
    ]
    counts = 1, EPISODES, EPISODES, EPISODES, EPISODES, PROCESSES, EPISODES
    taken = seconds(*works, repeats=repeats)
    bare, engine, alone, one, two, processes, cartesian = (
        t / n for t, n in zip(taken, counts, strict=True)
    )
    for vector in (*vectors, env):
        vector.close()
    for what, value, least in (
        ("1 thread / bare mj_step", bare / one, 0.85),
        ("2 threads / (2 x bare mj_step)", bare / two / 2, 0.85),
        ("2 threads / engine on 2 threads", engine / two, 0.85),
        ("2 threads / AsyncVectorEnv", processes / two, 1.4),
        ("1 thread, Cartesian, dense / mujoco.rollout", alone / cartesian, 0.8),
    ):
        yield Measurement(what=f"{name}: {what}", value=value, at_least=least)
    speed = len(actions) / two
    yield Measurement(what=f"{name}: control steps, 2 threads", value=speed, unit="/s")


def _engine(env: gym.Env, actions: NDArray[np.float32], threads: int) -> Work:
    """The motion of all episodes as steps of MuJoCo's threads alone."""
    state, ramps = controls(env, actions)
    batch = Batch(sim_of(env).simulation.model, EPISODES, threads, persistent=True)

    def begin() -> None:
        batch.state[:] = state
        batch.forward(stage=int(mujoco.mjtStage.mjSTAGE_VEL))

    def step(ramp: NDArray[np.float64]) -> None:
        batch.rollout(
            len(ramp), np.tile(ramp, (EPISODES, 1, 1)), control_spec=CONTROLS, record=()
        )

    return Work(pieces=in_pieces(step, ramps), prepare=begin)


def _rollout(env: gym.Env, actions: NDArray[np.float32]) -> Work:
    """The motion of all episodes as `mujoco.rollout` plays it in one thread, a piece a call."""
    model, (start, ramps) = sim_of(env).simulation.model, controls(env, actions)
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, start, STATE)
    first = np.empty(mujoco.mj_stateSize(model, PHYSICS))
    mujoco.mj_getState(model, data, first, PHYSICS)
    warmstarts = np.tile(data.qacc_warmstart, (EPISODES, 1))
    states = np.empty((EPISODES, len(first)))
    played = np.empty((EPISODES, PIECE * SUBSTEPS, len(first)))

    def begin() -> None:
        states[:] = first

    def play(ramp: NDArray[np.float64]) -> None:
        rollout_of_engine(
            model, data, states, ramp, initial_warmstart=warmstarts, state=played
        )
        states[:] = played[:, -1]

    pieces = np.concatenate(ramps).reshape(-1, PIECE * SUBSTEPS, model.nu)
    return Work(pieces=[partial(play, piece) for piece in pieces], prepare=begin)


def _tool_poses(actions: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return Cartesian actions (n, 16) along joint actions."""
    kinematics, poses = Kinematics(ROBOT), []
    for action in actions:
        command = DuoCommand.from_flat(action)
        tools = kinematics.forward(command.joints)
        poses.append(
            [[*tools[side].tquat, command.openings[side.index]] for side in SIDES]
        )
    return np.reshape(poses, actions.shape).astype(np.float32)


def _work(vector: gym.vector.VectorEnv, actions: NDArray[np.float32]) -> Work:
    several = [np.tile(action, (vector.num_envs, 1)) for action in actions]
    return Work(
        pieces=in_pieces(vector.step, several),
        prepare=lambda: vector.reset(options=dict(START)),
    )
