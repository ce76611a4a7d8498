"""What an adversary is: a script that does a task's deed without what the task is about.

An adversary acts through the action space, in the experts' motion vocabulary, and reads the
simulator as experts do. It shows that a stage means what it says: `deed` is what it really brings
about, so that no test passes because the adversary was clumsy, and `gets` the highest stage that
this is worth. Each task has a module here that lists its own as `ADVERSARIES`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from enum import Enum
from typing import Any

from duobench.experts.motion import Arms, Script
from duobench.sim.simulation import Simulation
from tests.steps import Act, do

Deed = Callable[[Simulation], bool]


class Hands(Enum):
    """Which arms an adversary uses; the test checks that it does."""

    ONE = "one arm alone: the other one is never told to move"
    TURNS = "two arms, never at the same time: they never touch the objects together"
    BOTH = "two arms as it likes"


@dataclass(frozen=True, slots=True)
class Adversary:
    """One way to cheat."""

    name: str
    """What it does, in a few words."""
    script: Callable[[Arms], Script]
    gets: int
    """The highest stage that it may reach: with its deed done it reaches this one exactly."""
    _: KW_ONLY
    deed: Deed
    """What holds at some control step if the script does what it is meant to do."""
    hands: Hands = Hands.BOTH
    seed: int = 0
    """First seed of the layouts that are tried until the deed is done."""
    settle: int = 45
    """Control steps for which the robot waits after the script: nothing may count later."""
    lacks: str = ""
    """Part of what the episode says about why it got no further."""


def cheats(deed: Deed, **usual: Any) -> Callable[..., Adversary]:
    """What makes rows `cheat(name, gets, *steps)` of a table, with what they usually have."""

    def cheat(name: str, gets: int, *steps: Act | tuple[Any, ...], **fields: Any) -> Adversary:
        return Adversary(name, do(*steps), gets, **{"deed": deed, **usual, **fields})

    return cheat


ONE, TURNS = {"hands": Hands.ONE}, {"hands": Hands.TURNS}
