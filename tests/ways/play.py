"""Playing ways, one episode each, without a time limit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType

import numpy as np

from duobench.core.types import OPENING_SLOTS, SIDES, Side
from duobench.world.sim.simulation import Simulation
from tests.task_harness import TaskHarness
from tests.ways.way import Hands, Way, WayFailedError

MAX_STEPS = 4000
"""Control steps after which a script is taken for one that does not get on."""
SETTLE = 45
"""Control steps for which the robot waits after the script: nothing of a cheat may count later."""
PATIENCE = 30
"""Control steps in a row at which a task is done when it is done for good: one second."""
MOVED = 1e-3
"""Change of a requested joint (radians) or opening by which an arm was told to move."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Judgement:
    """How an episode ended."""

    done: bool
    """Whether the way's deed was done: of a sincere one for a second, up to the end."""
    stage: int
    """The highest stage that was reached."""
    moved: frozenset[Side]
    """The arms that were told to move, if the way says which it uses."""
    together: bool
    """Whether both grippers ever touched objects at the same time, if it does."""


def ways_of(task: str) -> ModuleType:
    return import_module(f"tests.ways.{task}")


def play(bench: TaskHarness, way: Way, seed: int) -> Judgement:
    bench.start(seed)
    cheats, watched = way.gets is not None, way.hands is not Hands.BOTH
    bench.progress.explain(on=cheats)
    start = bench.sim.duo.command().flat.reshape(len(SIDES), -1)
    ever, together, failed, streak, moved = False, False, False, 0, set[Side]()
    try:
        for waiting in control_steps(bench, way, seed):
            holds = (cheats or waiting) and way.deed(bench.sim)
            ever, streak = ever or holds, streak + 1 if holds else 0
            if watched:
                together = together or len(hands_on(bench.sim)) > 1
                now = bench.requested.reshape(len(SIDES), -1)
                moved |= {side for side in SIDES if np.abs(now - start)[side.index].max() > MOVED}
    except WayFailedError:
        failed = True
    done = not failed and (ever if cheats else streak >= PATIENCE)
    return Judgement(done=done, stage=bench.stage, moved=frozenset(moved), together=together)


def control_steps(bench: TaskHarness, way: Way, seed: int) -> Iterator[bool]:
    """Act as a way does; after each control step, whether its script is over."""
    noise = np.random.default_rng((seed, 0x747265))

    def send(action: np.ndarray) -> None:
        shake = way.tremble * noise.normal(size=action.shape)
        shake[list(OPENING_SLOTS)] = 0.0
        bench.send(action + shake)

    steps, last = 0, bench.sim.duo.command().flat
    for _ in way.script(bench.arms):
        action = bench.arms.action()
        for part in range(1, way.slowness + 1):
            send(action - (action - last) * (1 - part / way.slowness))
            steps += 1
            yield False
        last = action
        if steps >= MAX_STEPS:
            raise WayFailedError
    for _ in range(SETTLE):
        send(bench.arms.action())
        yield True


def hands_on(sim: Simulation) -> set[Side]:
    """The sides whose grippers touch an object."""
    objects = [
        body
        for prop in sim.props.values()
        for body in (prop.name, *(prop.part_name(part.name) for part in prop.parts))
        if body in sim.contacts.owners
    ]
    return {side for side in SIDES if any(sim.contacts.gripper(side, body) for body in objects)}
