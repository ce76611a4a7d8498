"""What a sincere way is: a script that does a task as the expert would not, and does it.

It acts through the action space, in the experts' motion vocabulary, and reads the simulator as
experts do. It shows that no stage is refused to who did what it asks for. `done` says what a person
would call done: it is written from the task's description, asks nothing but the physics at the end,
and knows none of the predicates. Each task has a module here with its ways that must count, `WAYS`,
and with `sample`, from which a sweep takes ways at random.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from duobench.experts.motion import Arms, Script
from duobench.sim.simulation import Simulation
from duobench.types import SIDES


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

    def way(name: str = "", how: H = expert, **fields: Any) -> Way:
        script = fields.pop("script", lambda arms: act(arms, how))
        return Way(name=name or numbers(how, fields), script=script, done=done, **fields)

    return way


def numbers(how: object, fields: object) -> str:
    """What a way that was taken at random is called: its numbers."""
    return re.sub(r"\d+\.\d+", lambda number: f"{float(number[0]):.3g}", f"{how} {fields}")


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


SLOW, TURNING_SLOWLY = 0.02, 0.3
"""Speeds in m/s and rad/s below which a person would say that a thing does not move."""
PATIENCE = 30
"""Control steps in a row at which a task is done when it is done for good: one second."""
