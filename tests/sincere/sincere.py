"""What a sincere way is: a script that does a task as the expert would not, and does it.

It acts through the action space, in the experts' motion vocabulary, and reads the simulator as
experts do. It shows that no stage is refused to who did what it asks for. `done` says what a person
would call done: it is written from the task's description, asks nothing but the physics at the end,
and knows none of the predicates. Each task has a module here with its ways that must count, `WAYS`,
and with `sample`, from which a sweep takes ways at random.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from duobench.experts.motion import Arms, Script
from duobench.sim.simulation import Simulation


class WayFailedError(Exception):
    """A script sees that it did not do what it meant to, such as when it drops something."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Way:
    """One sincere way to do a task."""

    name: str
    """What is other than in the expert's way, in a few words."""
    script: Callable[[Arms], Script]
    """How it acts."""
    done: Callable[[Simulation], bool]
    """Whether the task is done, asked at every control step from the end of the script on."""
    tremble: float = 0.0
    """Standard deviation in radians of white noise in every joint target, at each control step."""
    slowness: int = 1
    """Control steps for each action of the script, which is approached in equal parts."""
    settle: int = 45
    """Control steps for which the robot waits after the script."""
    seed: int = 0
    """First seed of the layouts that are tried."""


H = TypeVar("H")


def ways_to(
    act: Callable[[Arms, H], Script], done: Callable[[Simulation], bool], expert: H
) -> Callable[..., Way]:
    """What makes ways of a script that takes a value; without one, the expert's."""

    def way(name: str, how: H = expert, **fields: Any) -> Way:
        return Way(name=name, script=lambda arms: act(arms, how), done=done, **fields)

    return way


PATIENCE = 30
"""Control steps in a row at which a task is done when it is done for good: one second."""
