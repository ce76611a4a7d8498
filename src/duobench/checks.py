"""Checks of numbers that come from outside: whole numbers, counts, sizes of images."""

from __future__ import annotations

import operator
from typing import Any


def whole(value: Any) -> int | None:
    """A whole number, Python's or NumPy's, as an int; None for anything else, also for a bool."""
    if isinstance(value, bool):
        return None
    try:
        return operator.index(value)
    except TypeError:
        return None


def count(value: Any) -> int | None:
    """A whole number from 1 on as an int; None for anything else."""
    number = whole(value)
    return number if number is not None and number >= 1 else None


def size(value: Any) -> tuple[int, int] | None:
    """Two counts, or one for a square, as height and width in pixels; None for anything else."""
    if (side := count(value)) is not None:
        return side, side
    try:
        pixels = [count(part) for part in value]
    except TypeError:
        return None
    match pixels:
        case [int(height), int(width)]:
            return height, width
    return None
