"""The file of a rig: what it refuses, and that it starts low."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from duobench.core.errors import OptionError
from duobench.core.types import Side
from duobench.real.rig import ArmConfig, GripperConfig
from tests.real.rigs import new_rig
from tests.real.simulated import simulated_rig


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
    plain = simulated_rig()
    with pytest.raises(OptionError, match="arms left and right"):
        replace(plain, arms={Side.LEFT: plain.arms[Side.LEFT]})


def test_everything_that_a_file_says_changes_its_hash(tmp_path: Path) -> None:
    plain, path = simulated_rig(), tmp_path / "rig.json"
    plain.write(path)
    again = new_rig(path).rig
    assert (again, again.hash) == (plain, plain.hash)
    assert simulated_rig([Side.LEFT], acceleration=1.0).hash != plain.hash
