"""A task that takes a second, and policies that behave and misbehave, for processes to import."""

import os
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from duobench.policy import HoldPolicy, PolicyMetadata, RandomPolicy
from duobench.randomness import around
from duobench.solids.blocks import CUBE_EDGE, RED, cube
from duobench.solids.prop import Prop
from duobench.stages.predicates import Moment, Predicate
from duobench.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task

HOME_HEIGHT = 0.54
HORIZON = 24
MARKS = "DUOBENCH_TEST_MARKS"
"""Environment variable: folder in which policies leave marks for other processes."""


def left_tool_moved(distance: float) -> Predicate:
    """Left tool is that far (metres) above or below its height at home."""

    def test(moment: Moment) -> bool:
        height = moment.simulation.site_pose("left/tcp").translation[2]
        return abs(float(height) - HOME_HEIGHT) > distance

    return Predicate(f"left tool moved {distance}", test)


def _task(name: str, distances: tuple[float, ...]) -> Task:
    return Task(
        id=name,
        title=name.title(),
        category=Category.PARALLEL_EXECUTION,
        instruction=f"Do the {name}.",
        horizon=HORIZON,
        props=(Prop(name="cube", solid=cube(RED)),),
        placements={"cube": Placement(x=around(0.5, 0.1), y=around(0, 0.1), z=CUBE_EDGE / 2)},
        stages=tuple(
            Stage(name=f"moved {distance} m", instruction="Move.", holds=left_tool_moved(distance))
            for distance in distances
        ),
    )


WAVE = _task("wave", (0.4, 0.6, 0.65))
NOD = _task("nod", (0.55, 0.7))
WAVE_NAME, NOD_NAME = f"{__name__}:WAVE", f"{__name__}:NOD"


def mark(text: str) -> bool:
    """Leave a mark that outlives this process; whether it is the first of its kind."""
    path = Path(os.environ[MARKS]) / text
    is_first = not path.exists()
    path.touch()
    return is_first


class DiesOnce(RandomPolicy):
    """Random, but kills its process in the middle of the first attempt at every episode."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        self._dies = mark(f"{instruction}-{seed}")
        self._acts = 0

    def act(self, observation: Mapping[str, Any]) -> Any:
        self._acts += 1
        if self._dies and self._acts == 5:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observation)


class DiesAlways(RandomPolicy):
    """Random, but kills its process in the middle of every episode with an even seed."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        self._dies = seed % 2 == 0

    def act(self, observation: Mapping[str, Any]) -> Any:
        if self._dies:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observation)


class Crashes(HoldPolicy):
    """Raises in the fourth step of every episode with an even seed."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        self._countdown = 4 if seed % 2 == 0 else HORIZON + 1

    def act(self, observation: Mapping[str, Any]) -> Any:
        self._countdown -= 1
        if self._countdown == 0:
            raise ZeroDivisionError("my policy is broken")
        return super().act(observation)


class Sees(HoldPolicy):
    """Asks for a small picture and acts in chunks of five."""

    metadata = PolicyMetadata(name="sees", cameras=("head",), image_size=(24, 32))

    def act(self, observation: Mapping[str, Any]) -> Any:
        if observation["pixels"]["head"].shape != (24, 32, 3):
            raise ValueError("this is not what was asked for")
        return np.repeat(super().act(observation), 5, axis=0)


class IsSlow(HoldPolicy):
    """Expects another control rate."""

    metadata = PolicyMetadata(name="is_slow", control_rate_hz=10.0)


class Exits(HoldPolicy):
    """Calls `sys.exit` in its first step."""

    def act(self, observation: Mapping[str, Any]) -> Any:  # noqa: ARG002 - sees nothing
        sys.exit(3)


class BreaksOnce(RandomPolicy):
    """Random, but raises in the first attempt at every episode with an even seed."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        if seed % 2 == 0 and mark(f"{instruction}-{seed}"):
            raise ZeroDivisionError("my policy was broken")


def cannot_be_made() -> None:
    raise ZeroDivisionError("no weights")


def dies_when_made() -> None:
    os.kill(os.getpid(), signal.SIGKILL)
