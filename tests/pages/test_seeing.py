"""Operators who get the page alone, its pixels and words, and what a newcomer is told of a task.

They are told: at the start both tools look straight down; the white cube lies in the left half of
the table, the black one in the right half; a cube is 32 mm high. The white block lies in the right
half, is as high and three times as long; the hand that takes it by one end and the one that takes
the other lean outwards and have their cameras outside, else they meet. From above arrows and drags
move a tool along the table; a tool's ring has a radius of 30 mm. With `--log-cli-level=INFO` they
say how long each layout was led.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

import pytest

from duobench.core.types import Side
from tests.pages.leading import follower, led
from tests.pages.screen_operator import BLACK_CUBE, CLOCK, ScreenOperator, pass_on, take

LOG = logging.getLogger(__name__)
WINDOW = {"width": 1240, "height": 780}
LIMIT_S = 60
"""Led seconds within which a cube is lifted."""
HANDED_OVER = 3
"""The stage at which the other arm holds the block."""

Play = Callable[[ScreenOperator], bool]


def played(folder: Path, task: str, layouts: int, play: Play) -> list[tuple[int, int]]:
    """Play the first layouts; the stage that each reached, and seconds that it was led."""
    reached = []
    with led(folder, task, follower("mouse"), WINDOW, CLOCK, episodes=layouts) as one:
        operator = ScreenOperator(one)
        for layout in range(layouts):
            one.begin()
            operator.begin()
            play(operator)
            reached.append((one.session.status()["stage"], operator.led_s))
            LOG.info("layout %d: stage %d, %d s led", layout, *reached[-1])
            operator.press("Backspace")
    return reached


def lifted_in_time(folder: Path, layouts: int) -> int:
    """In how many of the first layouts a cube is lifted in time."""

    def play(operator: ScreenOperator) -> bool:
        return take(operator, Side.RIGHT, BLACK_CUBE)

    reached = played(folder, "bin_sort", layouts, play)
    return sum(stage > 0 and seconds <= LIMIT_S for stage, seconds in reached)


@pytest.mark.slow
def test_a_cube_is_lifted_by_what_the_page_shows(tmp_path: Path) -> None:
    assert lifted_in_time(tmp_path, 1) == 1


@pytest.mark.long
def test_every_cube_is_lifted_by_what_the_page_shows(tmp_path: Path) -> None:
    assert lifted_in_time(tmp_path, 10) == 10


@pytest.mark.long
def test_most_blocks_are_handed_over_by_what_the_page_shows(tmp_path: Path) -> None:
    reached = played(tmp_path, "transfer_cube", 10, pass_on)
    assert sum(stage >= HANDED_OVER for stage, _seconds in reached) >= 7, reached
