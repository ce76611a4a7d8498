"""A teleoperator that LeRobot itself makes leads our arms."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig

from duobench.core.errors import LeaderError, UnknownNameError
from duobench.envs.spaces import JOINT_NAMES
from duobench.teleop.leaders.lerobot_source import LeRobotSource


@TeleoperatorConfig.register_subclass("sixteen_numbers")
@dataclass(kw_only=True)
class SixteenNumbersConfig(TeleoperatorConfig):
    start: float = 0.0


class SixteenNumbers(Teleoperator):
    config_class = SixteenNumbersConfig
    name = "sixteen_numbers"
    is_connected = False
    is_calibrated = True
    feedback_features: dict[str, type] = {}  # noqa: RUF012

    def __init__(self, config: SixteenNumbersConfig) -> None:
        super().__init__(config)
        self._start = config.start

    @property
    def action_features(self) -> dict[str, type]:
        return {f"{name}.pos": float for name in JOINT_NAMES}

    def connect(self, calibrate: bool = True) -> None:  # noqa: ARG002
        self.is_connected = True

    def calibrate(self) -> None: ...

    def configure(self) -> None: ...

    def get_action(self) -> dict[str, float]:
        return {f"{n}.pos": self._start + place for place, n in enumerate(JOINT_NAMES)}

    def send_feedback(self, feedback: dict[str, Any]) -> None: ...

    def disconnect(self) -> None:
        self.is_connected = False


def test_a_teleoperator_is_made_by_name_and_read(tmp_path: Path) -> None:
    module = ModuleType("sixteen_numbers")
    module.SixteenNumbers = SixteenNumbers  # type: ignore[attr-defined]
    sys.modules["sixteen_numbers"] = module
    SixteenNumbersConfig.__module__ = "sixteen_numbers"
    source = LeRobotSource.make("sixteen_numbers", start=0.5, calibration_dir=tmp_path)
    assert source.device == "lerobot sixteen_numbers"
    source.connect()
    sample = source.read()
    assert sample is not None
    np.testing.assert_allclose(sample, 0.5 + np.arange(16))
    source.close()
    with pytest.raises(LeaderError, match="cannot be made"):
        LeRobotSource.make("sixteen_numbers", colour="red")
    with pytest.raises(UnknownNameError, match="sixteen_numbers"):
        LeRobotSource.make("sixteen_number")
