"""Scripted ways to do a task, and to seem to do it.

A way acts through the action space, in the experts' motion vocabulary, and reads the simulator as
experts do. A sincere way does the task as the expert would not, and must count; an adversary does
the deed without what the task is about, and gets no more than this is worth. Each task has a module
here with its ways by name, `SINCERE` and `ADVERSARIES`, and with `sample`, from which a sweep takes
sincere ways at random.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, TypeVar

import numpy as np

from duobench.core.types import SIDES, Side
from duobench.tasks.experts.motion import Arms, Script
from duobench.world.sim.contacts import Limb, limb_owner
from duobench.world.sim.simulation import Simulation
from tests.steps import Act, do

Deed = Callable[[Simulation], bool]

SLOW, TURNING_SLOWLY = 0.02, 0.3
"""Speeds in m/s and rad/s below which a person would say that a thing does not move."""


class Hands(Enum):
    """Which arms a way uses; the test checks that it does."""

    ONE = "one arm alone: the other one is never told to move"
    TURNS = "two arms, never at the same time: they never touch the objects together"
    BOTH = "two arms as it likes"


ONE, TURNS = {"hands": Hands.ONE}, {"hands": Hands.TURNS}


class WayFailedError(Exception):
    """A script sees that it did not do what it meant to, such as when it drops something."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Way:
    """One way to act in a task."""

    script: Act
    deed: Deed
    """What it brings about, so that no test passes because the script was clumsy.

    An adversary's holds at some control step. A sincere way's holds at the end, for a second: it is
    what a person would call done, written from the task's description, asks nothing but the physics
    and knows none of the predicates.
    """
    gets: int | None = None
    """The stage that an adversary reaches and does not exceed; a sincere way has none, and reaches
    the last."""
    lacks: str = ""
    """Part of what the episode says about why an adversary got no further."""
    hands: Hands = Hands.BOTH
    seed: int = 0
    """First seed of the layouts that are tried until the deed is done."""
    tremble: float = 0.0
    """Standard deviation in radians of white noise in every joint target, at each control step."""
    slowness: int = 1
    """Control steps for each action of the script, which is approached in equal parts."""
    how: object = None
    """The numbers that the script takes, if it takes some."""

    def __str__(self) -> str:
        text = f"{self.how}, slowness {self.slowness}, tremble {self.tremble}"
        return re.sub(r"\d+\.\d+", lambda number: f"{float(number[0]):.3g}", text)


H = TypeVar("H")


def cheats(deed: Deed, **usual: Any) -> Callable[..., Way]:
    """What makes adversaries `cheat(gets, *steps)`, with what they usually have."""

    def cheat(gets: int, *steps: Act | tuple[Any, ...], **fields: Any) -> Way:
        return Way(script=do(*steps), gets=gets, **{"deed": deed, **usual, **fields})

    return cheat


def ways_to(act: Callable[[Arms, H], Script], done: Deed, expert: H) -> Callable[..., Way]:
    """What makes sincere ways of a script that takes numbers: the expert's with some changed."""

    def way(
        how: H = expert,
        *,
        script: Act | None = None,
        seed: int = 0,
        tremble: float = 0.0,
        slowness: int = 1,
        **changes: Any,
    ) -> Way:
        how = replace(how, **changes)  # type: ignore[type-var]
        return Way(
            script=script or (lambda arms: act(arms, how)),
            deed=done,
            seed=seed,
            tremble=tremble,
            slowness=slowness,
            how=how,
        )

    return way


def random_tempo(
    rng: np.random.Generator, *, slowly: float = 0.15, trembling: float = 0.15
) -> dict[str, Any]:
    """Now and then half the speed, now and then a tremble of 10 mrad."""
    slow, trembles = rng.random(2) < (slowly, trembling)
    return {"slowness": 1 + int(slow), "tremble": 0.01 * float(trembles)}


def left_alone(sim: Simulation, *props: str) -> bool:
    """No gripper touches any of them, and none moves."""
    for prop in props:
        if any(sim.contacts.gripper(side, prop) for side in SIDES):
            return False
        speed, turning = sim.speed(prop)
        if speed > SLOW or turning > TURNING_SLOWLY:
            return False
    return True


def tilt(sim: Simulation, prop: str) -> float:
    """Angle of its up axis against the world's, in radians."""
    return math.acos(min(1.0, max(-1.0, float(sim.rotation(prop)[2, 2]))))


def fingers_on(bodies: Mapping[Side, str]) -> Deed:
    """The deed that both fingers of grippers touch bodies."""
    fingers = (Limb.LEFT_FINGER, Limb.RIGHT_FINGER)

    def deed(sim: Simulation) -> bool:
        return all(
            sim.contacts.between(limb_owner(side, finger), body)
            for side, body in bodies.items()
            for finger in fingers
        )

    return deed
