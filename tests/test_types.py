"""The order of the 16 numbers, and what a side is."""

from __future__ import annotations

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from duobench.types import SIDES, DuoCommand, DuoState, Side


def test_the_flat_order_is_left_joints_opening_right_joints_opening() -> None:
    flat = np.arange(16.0)
    command = DuoCommand.from_flat(flat)
    assert command.joints.tolist() == [list(range(7)), list(range(8, 15))]
    assert command.openings.tolist() == [7.0, 15.0]
    assert np.array_equal(command.flat, flat)


def test_a_command_made_of_parts_is_the_same_as_a_flat_one() -> None:
    rng = np.random.default_rng(0)
    joints, openings = rng.normal(size=(2, 7)), rng.uniform(size=2)
    command = DuoCommand(joints=joints, openings=openings)
    again = DuoCommand.from_flat(command.flat)
    assert np.array_equal(again.joints, joints)
    assert np.array_equal(again.openings, openings)


def test_a_state_is_flat_in_the_same_order() -> None:
    joints, openings = np.arange(14.0).reshape(2, 7), np.array([0.25, 0.75])
    state = DuoState(joints=joints, openings=openings, tcp_poses=np.zeros((2, 7)))
    assert np.array_equal(state.flat, DuoCommand(joints=joints, openings=openings).flat)


def test_the_flat_numbers_are_a_copy() -> None:
    command = DuoCommand(joints=np.zeros((2, 7)), openings=np.zeros(2))
    command.flat[:] = 1.0
    assert not command.joints.any()


@pytest.mark.parametrize("size", [14, 15, 17, 32])
def test_another_count_is_refused(size: int) -> None:
    with pytest.raises(ValueError, match="reshape"):
        DuoCommand.from_flat(np.zeros(size))


def test_commands_are_frozen() -> None:
    command = DuoCommand.from_flat(np.zeros(16))
    with pytest.raises(FrozenInstanceError):
        command.openings = np.ones(2)  # type: ignore[misc]


def test_sides() -> None:
    assert SIDES == (Side.LEFT, Side.RIGHT)
    assert [side.index for side in SIDES] == [0, 1]
    for side in SIDES:
        assert side.other is not side
        assert side.other.other is side
        assert Side(str(side)) is side
