"""How much of the bare engine's speed an environment keeps, and how long it takes to begin."""

import math
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
from benchmarks.measure import Measurement, Work, seconds
from duobench.envs.duo_env import DuoEnv
from duobench.scene.compose import SUBSTEPS
from duobench.sim.simulation import STATE

STEPS = 240
"""Control steps in one timed stretch: eight seconds of an episode."""
PIECE = 8
"""Control steps that are timed at a time."""
SWING = 0.1
"""How far every joint swings meanwhile, in radians."""

# The evaluation protocol, in a process that has done nothing yet: what a user waits for.
CREATION = """
import sys, time
import duobench
start = time.perf_counter()
env = duobench.make(sys.argv[1])
print(time.perf_counter() - start)
env.close()
"""


def measure_steps(name: str, repeats: int = 25) -> Iterator[Measurement]:
    """Measure control steps without cameras, against bare physics steps of the same motion."""
    env = duobench.make(name, cameras=False, horizon=STEPS + 1)
    actions = swinging(env)
    wrapped, bare = seconds(
        wrapped_physics(env, actions), bare_physics(env, actions), repeats=repeats
    )
    env.close()
    yield Measurement(
        what=f"{name}: step, bare mj_step / environment", value=bare / wrapped, at_least=0.85
    )
    yield Measurement(what=f"{name}: control steps", value=STEPS / wrapped, unit="/s")


def measure_creation(name: str, repeats: int = 3) -> Iterator[Measurement]:
    """Measure making an environment in a fresh process, with the mesh cache warm."""
    command = [sys.executable, "-c", CREATION, name]
    times = [
        float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        for _ in range(repeats)
    ]
    yield Measurement(
        what=f"{name}: creation", value=statistics.median(times), unit="s", at_most=3.0
    )


def measure_resets(name: str, repeats: int = 20) -> Iterator[Measurement]:
    """Measure resets of the evaluation protocol, the pictures of three cameras included."""
    env = duobench.make(name)
    env.reset(seed=0)
    times = []
    for seed in range(repeats):  # every seed has a layout, and so a time, of its own
        start = time.perf_counter()
        env.reset(seed=seed)
        times.append(time.perf_counter() - start)
    env.close()
    yield Measurement(what=f"{name}: reset", value=statistics.median(times), unit="s", at_most=0.1)


def base_of(env: gym.Env) -> DuoEnv:
    """Return the environment under all wrappers."""
    base = env.unwrapped
    if not isinstance(base, DuoEnv):
        raise TypeError(f"Expected a DuoBench environment, got {base}.")
    return base


def begin(env: gym.Env) -> None:
    """Begin the episode that everything here is measured on."""
    env.reset(seed=0)


def swinging(env: gym.Env) -> NDArray[np.float32]:
    """Return actions (STEPS, 16) in which all arm joints swing once around where they stand."""
    begin(env)
    state = base_of(env).simulation.duo.read()
    phase = 2 * math.pi * np.arange(STEPS) / STEPS
    moves = np.ones(state.flat.shape)
    moves[[7, 15]] = 0.0  # the grippers stay open
    return (state.flat + SWING * np.sin(phase)[:, None] * moves).astype(np.float32)


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


def bare_physics(env: gym.Env, actions: NDArray[np.float32]) -> Work:
    """Return the same motion as `mj_step` alone, on the same model and from the same state."""
    simulation = base_of(env).simulation
    model, data = simulation.model, mujoco.MjData(simulation.model)
    begin(env)
    state, controls = simulation.save(), []
    for action in actions:
        env.step(action)
        controls.append(simulation.data.ctrl.copy())

    def step(control: NDArray[np.float64]) -> None:
        data.ctrl[:] = control
        for _ in range(SUBSTEPS):
            mujoco.mj_step(model, data)

    return Work(
        pieces=in_pieces(step, controls),
        prepare=lambda: mujoco.mj_setState(model, data, state, STATE),
    )
