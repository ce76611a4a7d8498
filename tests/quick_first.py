"""Rows of parametrized tests: the first ones are played by default, the others are slow."""

from collections.abc import Iterable
from typing import Any

import pytest


def quick_first(values: Iterable[Any], *, quick: int = 1) -> list[Any]:
    """Rows that prove one rule again and again, of which the first few are quick.

    Args:
        values: A value a row, or a tuple of several.
        quick: How many rows are played by default.
    """
    return [
        pytest.param(
            *(each if isinstance(each, tuple) else (each,)),
            marks=() if place < quick else pytest.mark.slow,
        )
        for place, each in enumerate(values)
    ]
