from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from duobench.spatial import SE3
from duobench.teleop.clutch import Clutch
from duobench.teleop.messages import Hand, Hands, read
from tests.teleop.operator import hand, message

TOOL = SE3.about((1, 2, 3), 2.0) @ SE3.at(0.4, 0.1, 0.2)
HELD = SE3.about((3, 1, 2), 1.0)


def sample(pose: SE3, squeeze: float, **more: Any) -> Hand:
    said = read(message(0, hand(pose, squeeze=squeeze) | more, None))
    assert isinstance(said, Hands)
    assert said.left is not None
    return said.left


def closed(pose: SE3 = HELD, tool: SE3 = TOOL, **scales: float) -> Clutch:
    """A clutch that was closed by a hand at a pose."""
    clutch = Clutch(**scales)
    assert clutch.follow(sample(pose, 0.0), tool) is None
    assert clutch.follow(sample(pose, 1.0), tool) is not None
    return clutch


def same(one: SE3 | None, other: SE3, tolerance: float = 1e-9) -> None:
    assert one is not None
    assert max(one.distance(other)) < tolerance


def test_the_tool_moves_by_exactly_what_the_hand_moves() -> None:
    clutch = closed()
    same(clutch.follow(sample(HELD, 1.0), TOOL), TOOL)
    there = clutch.follow(sample(HELD.moved(0.05, 0.0, 0.10), 1.0), TOOL)
    same(there, TOOL.moved(0.05, 0.0, 0.10))


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (1, -1, 2)])
def test_the_tool_turns_about_the_axes_of_the_room(axis: tuple[float, ...]) -> None:
    turn = SE3.about(axis, 0.6)
    turned = SE3((turn @ HELD).rotation, HELD.translation)
    expected = SE3((turn @ TOOL).rotation, TOOL.translation)
    same(closed().follow(sample(turned, 1.0), TOOL), expected)


def test_scales_shorten_movements_and_turns() -> None:
    clutch = closed(scale=0.4, turn_scale=0.25)
    turn, quarter = SE3.about((0, 0, 1), 0.8), SE3.about((0, 0, 1), 0.2)
    moved = SE3((turn @ HELD).rotation, HELD.moved(x=0.1).translation)
    expected = SE3((quarter @ TOOL).rotation, TOOL.moved(x=0.04).translation)
    same(clutch.follow(sample(moved, 1.0), TOOL), expected)


def test_release_return_and_squeeze_move_nothing() -> None:
    clutch = closed()
    there = clutch.follow(sample(HELD.moved(x=0.1), 1.0), TOOL)
    assert there is not None
    for pose in (HELD.moved(x=0.1), HELD, HELD.moved(y=-0.3)):
        assert clutch.follow(sample(pose, 0.0), there) is None
    same(clutch.follow(sample(HELD.moved(y=-0.3), 1.0), there), there)
    same(clutch.follow(sample(HELD.moved(y=-0.3, z=0.02), 1.0), there), there.moved(z=0.02))


def test_a_squeeze_that_was_never_released_leads_nothing() -> None:
    clutch = Clutch()
    for pose in (HELD, HELD.moved(x=0.2)):
        assert clutch.follow(sample(pose, 1.0), TOOL) is None


@pytest.mark.parametrize("lost", [None, "unsure"])
def test_a_hand_that_was_lost_needs_a_release_and_a_new_squeeze(lost: str | None) -> None:
    clutch = closed()
    gone = None if lost is None else sample(HELD, 1.0, sure=False)
    assert clutch.follow(gone, TOOL) is None
    assert clutch.follow(sample(HELD.moved(x=0.3), 1.0), TOOL) is None
    assert clutch.follow(sample(HELD.moved(x=0.3), 0.0), TOOL) is None
    same(clutch.follow(sample(HELD.moved(x=0.3), 1.0), TOOL), TOOL)


def test_a_trembling_finger_does_not_let_go() -> None:
    clutch = closed()
    for squeeze in (0.49, 0.55, 0.31, 0.5):
        assert clutch.follow(sample(HELD, squeeze), TOOL) is not None
    assert clutch.follow(sample(HELD, 0.29), TOOL) is None
    assert clutch.follow(sample(HELD, 0.49), TOOL) is None
    assert np.isclose(clutch.follow(sample(HELD, 0.5), TOOL).translation, TOOL.translation).all()  # type: ignore[union-attr]
