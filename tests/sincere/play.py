"""Playing sincere ways, one episode each, without a time limit."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from types import ModuleType

import numpy as np

from duobench.types import OPENING_SLOTS
from tests.sincere.sincere import PATIENCE, Way, WayFailedError
from tests.task_harness import TaskHarness

MAX_STEPS = 4000
"""Control steps after which a script is taken for one that does not get on."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Judgement:
    """How an episode ended."""

    done: bool
    """Whether the task is done by what a person sees: for a second, up to the end."""
    stage: int
    """The highest stage that was reached."""
    steps: int
    """Control steps of the script."""


def ways_of(task: str) -> ModuleType:
    """The module with a task's sincere ways."""
    return import_module(f"tests.sincere.{task}")


def play(bench: TaskHarness, way: Way, seed: int) -> Judgement:
    """Play one episode of a way."""
    bench.start(seed)
    noise = np.random.default_rng((seed, 0x747265))
    steps = streak = 0

    def send(action: np.ndarray) -> None:
        shake = way.tremble * noise.normal(size=action.shape)
        shake[list(OPENING_SLOTS)] = 0.0
        bench.send(action + shake)

    last = bench.sim.duo.command().flat
    try:
        for _ in way.script(bench.arms):
            action = bench.arms.action()
            for part in range(1, way.slowness + 1):
                send(last + (action - last) * (part / way.slowness))
                steps += 1
            last = action
            if steps >= MAX_STEPS:
                raise WayFailedError
    except WayFailedError:
        return Judgement(done=False, stage=bench.stage, steps=steps)
    for _ in range(max(way.settle, PATIENCE)):
        send(bench.arms.action())
        streak = streak + 1 if way.done(bench.sim) else 0
    return Judgement(done=streak >= PATIENCE, stage=bench.stage, steps=steps)
