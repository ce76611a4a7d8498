"""A shift: an axis along which episodes differ from the usual ones, and how far."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from duobench.core.errors import OptionError, check_known
from duobench.core.types import as_whole

NO_AXIS, ALL_AXES = "none", "all"
LOOK, CAMERA, LAYOUT, PHYSICS = "look", "camera", "layout", "physics"
INSTRUCTION, SENSING, LATENCY = "instruction", "sensing", "latency"
RENDERER = "renderer"
SINGLE_AXES = (LOOK, CAMERA, LAYOUT, PHYSICS, INSTRUCTION, SENSING, LATENCY)
AXES = (*SINGLE_AXES, ALL_AXES)
"""Axes of the suite robust; the page on robustness explains each."""
EVERY_AXIS = (*AXES, RENDERER)
"""Axes along which episodes may be shifted; another renderer needs Vulkan and is in no suite."""
LEVELS = 5
"""Levels 1 to 5 of each axis; 0 is no shift."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Shift:
    """An axis, or all together, and a level; without one, nothing differs."""

    axis: str = NO_AXIS
    """One of `EVERY_AXIS`, or "none"."""
    level: int = 0
    """1 to 5; 0 where nothing is shifted."""

    def __post_init__(self) -> None:
        check_known("axis of a shift", self.axis, (NO_AXIS, *EVERY_AXIS))
        level = as_whole(self.level)
        lowest = 0 if self.axis == NO_AXIS else 1
        highest = 0 if self.axis == NO_AXIS else LEVELS
        if level is None or not lowest <= level <= highest:
            raise OptionError(
                f"Levels of a shift are 1 to {LEVELS}, and 0 without an axis; got {self.level!r} "
                f"of axis {self.axis}."
            )

    @classmethod
    def parse(cls, text: str) -> "Shift":
        """A shift from its name: "none", or an axis and a level such as "look-3"."""
        if text == NO_AXIS:
            return NO_SHIFT
        found = re.fullmatch(r"(\w+)-([0-9]{1,3})", text)
        if found is None:
            raise OptionError(f"A shift is AXIS-LEVEL, such as look-3; got {text!r}.")
        return cls(axis=found[1], level=int(found[2]))

    @property
    def name(self) -> str:
        """Text that `parse` takes, and the name of a folder."""
        return self.axis if self.axis == NO_AXIS else f"{self.axis}-{self.level}"

    def __str__(self) -> str:
        if self.axis == NO_AXIS:
            return "no shift"
        what = "all axes" if self.axis == ALL_AXES else self.axis
        return f"{what} at level {self.level}"

    def level_of(self, axis: str) -> int:
        """Level along one axis, 0 to 5."""
        is_meant = self.axis == axis or (self.axis == ALL_AXES and axis != RENDERER)
        return self.level if is_meant else 0


NO_SHIFT = Shift()
"""Nothing differs."""


def every_shift(axes: Sequence[str] = AXES) -> Iterator[Shift]:
    """No shift, then each axis at each level."""
    yield NO_SHIFT
    for axis in axes:
        for level in range(1, LEVELS + 1):
            yield Shift(axis=axis, level=level)
