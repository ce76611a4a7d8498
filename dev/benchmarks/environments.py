"""How much of the bare engine's speed an environment keeps, and how long it takes to begin."""

import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

import duobench
from dev.benchmarks.measure import Measurement, Work, seconds
from dev.benchmarks.steps import Steps
from duobench.envs.sim_env import sim_of
from duobench.evaluation.policies import ExpertPolicy
from duobench.evaluation.rollout import rollout
from duobench.world.sim.duo import ramp
from duobench.world.sim.simulation import STATE

SEED = 0
"""Seed of the episode that everything here is measured on."""
PIECE = 8
"""Control steps that are timed at a time."""

# The evaluation protocol, in a process that has done nothing yet: what a user waits for.
CREATION = """
import sys, time
import duobench
start = time.perf_counter()
env = duobench.make(sys.argv[1])
print(time.perf_counter() - start)
env.close()
"""


def measure_steps(name: str, repeats: int = 15) -> Iterator[Measurement]:
    """Measure an expert's whole episode without cameras, against bare steps of the same motion."""
    env = duobench.make(name, cameras=False)
    actions = expert_actions(env)
    wrapped, bare = seconds(
        wrapped_physics(env, actions), bare_physics(env, actions), repeats=repeats
    )
    env.close()
    yield Measurement(
        what=f"{name}: step, bare mj_step / environment", value=bare / wrapped, at_least=0.85
    )
    yield Measurement(
        what=f"{name}: control steps", value=len(actions) / wrapped, unit="/s", at_least=150
    )


def measure_creation(name: str, repeats: int = 3) -> Iterator[Measurement]:
    """Measure making an environment in a fresh process."""
    command = [sys.executable, "-c", CREATION, name]
    times = [
        float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        for _ in range(repeats)
    ]
    yield Measurement(
        what=f"{name}: creation", value=statistics.median(times), unit="s", at_most=3.0
    )


def measure_resets(name: str, repeats: int = 20) -> Iterator[Measurement]:
    """Measure resets of the evaluation protocol, the images of three cameras included."""
    env = duobench.make(name)
    env.reset(seed=0)
    times = []
    for seed in range(repeats):  # every seed has a layout, and so a time, of its own
        start = time.perf_counter()
        env.reset(seed=seed)
        times.append(time.perf_counter() - start)
    env.close()
    yield Measurement(what=f"{name}: reset", value=statistics.median(times), unit="s", at_most=0.1)


def begin(env: gym.Env) -> None:
    """Begin the episode that everything here is measured on."""
    env.reset(seed=SEED)


def expert_actions(env: gym.Env) -> NDArray[np.float32]:
    """Return the actions (n, 16) of the task's expert until the end of its episode."""
    steps = Steps()
    rollout(env, ExpertPolicy(env), seed=SEED, watchers=[steps])
    return np.array([step.action for step in steps], dtype=np.float32)


def in_pieces(step: Callable[[Any], object], inputs: Sequence[Any]) -> list[Callable[[], object]]:
    """Cut a motion, one input a control step, into pieces of `PIECE` steps."""

    def piece(start: int) -> Callable[[], object]:
        def run() -> None:
            for given in inputs[start : start + PIECE]:
                step(given)

        return run

    return [piece(start) for start in range(0, len(inputs), PIECE)]


def wrapped_physics(env: gym.Env, actions: NDArray[np.float32]) -> Work:
    """Return the motion as steps of the environment."""
    return Work(pieces=in_pieces(env.step, list(actions)), prepare=lambda: begin(env))


def controls(
    env: gym.Env, actions: NDArray[np.float32]
) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
    """Return the state at the start of an episode, and the controls (substeps, n) of each step."""
    simulation = sim_of(env).simulation
    begin(env)
    state, ramps = simulation.get_state(), []
    for action in actions:
        start = simulation.data.ctrl.copy()
        env.step(action)
        ramps.append(ramp(start, simulation.data.ctrl))
    return state, ramps


def bare_physics(env: gym.Env, actions: NDArray[np.float32]) -> Work:
    """Return the same motion as `mj_step` alone, on the same model and from the same state.

    Raises:
        RuntimeError: It does not end in the same state, so there is nothing to compare.
    """
    simulation = sim_of(env).simulation
    model, data = simulation.model, mujoco.MjData(simulation.model)
    target = data.ctrl
    state, ramps = controls(env, actions)

    def step(ramp: NDArray[np.float64]) -> None:
        for controls in ramp:
            target[:] = controls
            mujoco.mj_step(model, data)

    work = Work(
        pieces=in_pieces(step, ramps),
        prepare=lambda: mujoco.mj_setState(model, data, state, STATE),
    )
    seconds(work, repeats=1)
    if not np.array_equal(data.qpos, simulation.data.qpos):
        raise RuntimeError("Bare physics moved in another way than the environment.")
    return work
