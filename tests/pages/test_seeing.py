"""Operators who get the page alone, its pixels and words, and what a newcomer is told of a task.

They are told: at the start both tools look straight down; the white cube lies in the left half of
the table, the black one in the right half; a cube is 32 mm high. From above arrows and drags move a
tool along the table. With `--log-cli-level=INFO` they say how long each layout was led.
"""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from duobench.core.types import Side
from tests.pages.leading import follower, led
from tests.pages.screen_operator import BLACK_CUBE, CLOCK, ScreenOperator, take

LOG = logging.getLogger(__name__)
WINDOW = {"width": 1240, "height": 780}
NEVER = 1000
MOST = 8
UNSTEADY = pytest.mark.xfail(
    reason="Its program knew the page's layout of before: 7 of 8 cubes then, the first not now.",
    strict=False,
)
LIMIT_S = 60
"""Led seconds within which a cube is lifted."""


def lifted(folder: Path, layouts: int) -> list[int]:
    """Lift a cube in the first layouts; seconds that each was led, as the page says."""
    times = []
    with led(folder, "bin_sort", follower("mouse"), WINDOW, CLOCK, episodes=layouts) as one:
        operator = ScreenOperator(one)
        for layout in range(layouts):
            one.begin()
            is_lifted = take(operator, Side.RIGHT, BLACK_CUBE)
            times.append(operator.led_s if is_lifted else NEVER)
            LOG.info("layout %d: lifted %s, %d s led", layout, is_lifted, operator.led_s)
            operator.press("Backspace")
    return times


@UNSTEADY
@pytest.mark.slow
def test_a_cube_is_lifted_by_what_the_page_shows(tmp_path: Path) -> None:
    assert max(lifted(tmp_path, 1)) <= LIMIT_S


@UNSTEADY
@pytest.mark.long
def test_most_cubes_are_lifted_by_what_the_page_shows(tmp_path: Path) -> None:
    times = lifted(tmp_path, 10)
    assert sum(time <= LIMIT_S for time in times) >= MOST, times
