"""The file of a rig: what it refuses, and that it starts low."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from duobench.core.errors import FileError, OptionError
from duobench.core.types import Side
from duobench.real.rig import ArmConfig, GripperConfig, Rig
from tests.real.rigs import new_rig


@pytest.mark.parametrize(
    "wrong",
    [
        {"speed_fraction": 0.51},
        {"speed_fraction": 0.0},
        {"acceleration": 6.5},
        {"home_fraction": 0.6},
        {"torque_threshold": (150.0,) * 7},
        {"force_threshold": 0.0},
        {"stiffness": (1.0,)},
        {"damping": (float("nan"),) * 7},
    ],
)
def test_an_arm_may_not_be_faster_or_stronger_than_any_rig(wrong: dict[str, Any]) -> None:
    with pytest.raises(OptionError, match=next(iter(wrong))):
        ArmConfig(**wrong)


@pytest.mark.parametrize("wrong", [{"open_count": 230}, {"speed": 256}, {"closed_count": -1}])
def test_ends_of_a_gripper_are_bytes_in_order(wrong: dict[str, int]) -> None:
    with pytest.raises(OptionError):
        GripperConfig(**wrong)


def test_a_rig_has_both_arms() -> None:
    plain = Rig.simulated()
    with pytest.raises(OptionError, match="arms left and right"):
        replace(plain, arms={Side.LEFT: plain.arms[Side.LEFT]})


def test_everything_that_a_file_says_changes_its_hash(tmp_path: Path) -> None:
    plain, path = Rig.simulated(), tmp_path / "rig.json"
    plain.write(path)
    again = new_rig(path).rig
    assert (again, again.hash) == (plain, plain.hash)
    slower = replace(plain.arms[Side.LEFT], acceleration=1.0)
    other = replace(plain, arms={**plain.arms, Side.LEFT: slower})
    assert other.hash != plain.hash


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        '{"name": "x"}',
        '{"name": "x", "arms": {"left": {"speed_fraction": 2}, "right": {}}, "grippers": {}}',
    ],
)
def test_what_is_no_rig_is_told_with_its_path(tmp_path: Path, content: str) -> None:
    path = tmp_path / "rig.json"
    path.write_text(content)
    with pytest.raises(FileError, match=r"Cannot read a rig from .*rig\.json"):
        Rig.read(path)
