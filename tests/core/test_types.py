"""The order of the 16 numbers, and what a side is."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from duobench.core.errors import TaskError
from duobench.core.types import (
    SIDES,
    DuoCommand,
    DuoState,
    Side,
    as_several,
    as_size,
    check_several,
    check_unit,
)


def test_the_flat_order_is_left_joints_opening_right_joints_opening() -> None:
    flat = np.arange(16.0)
    command = DuoCommand.from_flat(flat)
    assert command.joints.tolist() == [list(range(7)), list(range(8, 15))]
    assert command.openings.tolist() == [7.0, 15.0]
    assert np.array_equal(command.flat, flat)


def test_parts_of_a_command_or_state_are_flat_in_the_same_order() -> None:
    joints, openings = np.arange(14.0).reshape(2, 7), np.array([0.25, 0.75])
    command = DuoCommand(joints=joints, openings=openings)
    again = DuoCommand.from_flat(command.flat)
    assert np.array_equal(again.joints, joints)
    assert np.array_equal(again.openings, openings)
    state = DuoState(joints=joints, openings=openings, tcp_poses=np.zeros((2, 7)))
    assert np.array_equal(state.flat, command.flat)


def test_commands_cannot_be_changed() -> None:
    command = DuoCommand.from_flat(np.zeros(16))
    command.flat[:] = 1.0
    assert not command.joints.any()
    with pytest.raises(FrozenInstanceError):
        command.openings = np.ones(2)  # type: ignore[misc]


@pytest.mark.parametrize("size", [14, 15, 17, 32])
def test_another_count_is_refused(size: int) -> None:
    with pytest.raises(ValueError, match="reshape"):
        DuoCommand.from_flat(np.zeros(size))


def test_sides() -> None:
    assert SIDES == (Side.LEFT, Side.RIGHT)
    assert [side.index for side in SIDES] == [0, 1]
    for side in SIDES:
        assert side.other is not side
        assert side.other.other is side
        assert Side(str(side)) is side


def test_any_kind_of_number_has_a_unit_and_nothing_else() -> None:
    check_unit("It", "metres", 2.0, 1, 0.1, np.float32(0.1), np.int64(1), np.array(0.1))
    check_unit("It", "metres", 2.0, -np.inf, endless=True)
    for value in ("0.1", None, np.nan, np.inf, 2.1):
        with pytest.raises(TaskError, match="It is a number in metres, at most 2 either way; got"):
            check_unit("It", "metres", 2.0, value)


def test_several_things_have_an_order() -> None:
    for values in (["a", "b"], ("a", "b"), {"a": 1, "b": 2}.keys(), (letter for letter in "ab")):
        assert as_several(values) == ("a", "b")
    assert as_several("ab") == ("ab",)
    for values in ({"a", "b"}, frozenset("ab"), {"a": 1}, b"ab", 3, None, True, np.array(3)):
        assert as_several(values) is None
        with pytest.raises(TaskError, match=r"takes strs"):
            check_several("It", values if isinstance(values, set | frozenset) else 3, str)
    for size in ({128, 64}, {128: 64, 64: 128}, "22", b"@@", np.array(3.5)):
        assert as_size(size) is None
