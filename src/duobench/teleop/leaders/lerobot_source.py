"""Teleoperators of LeRobot as leader arms.

Any teleoperator will do whose actions are our 16 numbers: `left_joint_1` to `right_gripper`, with
LeRobot's ending `.pos` or without; joints in radians, grippers 0 closed to 1 open. LeRobot is
imported where one is made by name, and nowhere else.
"""

import math
from typing import Any, Self

import numpy as np

from duobench.core.errors import LeaderError, UnknownNameError
from duobench.core.lerobot_keys import POSITION
from duobench.core.machine import load_extra
from duobench.core.types import Array
from duobench.envs.spaces import JOINT_NAMES

NEEDED = "Teleoperators of LeRobot need LeRobot"


class LeRobotSource:
    """A teleoperator of LeRobot with our 16 numbers.

    Args:
        teleoperator: A `lerobot.teleoperators.Teleoperator`, connected or not.
        device: What it is called in recordings; LeRobot's name for it if not given.

    Raises:
        LeaderError: Its actions lack one of our numbers, or have others.
    """

    def __init__(self, teleoperator: Any, device: str | None = None) -> None:
        self._teleoperator = teleoperator
        self.device = device or f"lerobot {getattr(teleoperator, 'name', 'teleoperator')}"
        plain = {key.removesuffix(POSITION): key for key in teleoperator.action_features}
        if set(plain) != set(JOINT_NAMES) or len(plain) != len(teleoperator.action_features):
            raise LeaderError(
                f"{self.device} gives {', '.join(teleoperator.action_features) or 'nothing'}; two "
                f"leader arms give exactly {JOINT_NAMES[0]}{POSITION} to "
                f"{JOINT_NAMES[-1]}{POSITION}, seven joints in radians and a gripper on each side."
            )
        self._keys = [plain[name] for name in JOINT_NAMES]

    @classmethod
    def make(cls, kind: str, **options: Any) -> Self:
        """A teleoperator by LeRobot's name for its kind, also one of an installed plugin.

        Args:
            kind: The name, as `lerobot-teleoperate --teleop.type` takes it.
            options: Fields of its configuration, such as `port`.

        Raises:
            LeaderError: LeRobot is not installed, an option is wrong, or the actions are not ours.
            UnknownNameError: There is no such teleoperator.
        """
        teleoperators, plugins = (
            load_extra(f"lerobot.{name}", "lerobot", NEEDED, LeaderError)
            for name in ("teleoperators", "utils.import_utils")
        )
        plugins.register_third_party_plugins()
        kinds = teleoperators.TeleoperatorConfig.get_known_choices()
        if kind not in kinds:
            raise UnknownNameError("teleoperator of LeRobot", kind, kinds)
        try:
            config = kinds[kind](**options)
        except (TypeError, ValueError) as error:
            raise LeaderError(f"The teleoperator {kind!r} cannot be made: {error}") from error
        return cls(teleoperators.make_teleoperator_from_config(config), f"lerobot {kind}")

    def connect(self) -> None:
        """Reach the leaders, or raise a `LeaderError`."""
        if self._teleoperator.is_connected:
            return
        try:
            self._teleoperator.connect()
        except (OSError, RuntimeError) as error:
            raise LeaderError(f"{self.device} cannot be reached: {error}") from error

    def read(self) -> Array | None:
        """Where they are now (16,); None where they cannot be read, or give no numbers."""
        try:
            action = self._teleoperator.get_action()
            numbers = [float(action[key]) for key in self._keys]
        except (OSError, RuntimeError, KeyError, TypeError, ValueError):
            return None
        return np.array(numbers) if math.isfinite(sum(numbers)) else None

    def close(self) -> None:
        """Let go of them; closing twice is harmless."""
        if self._teleoperator.is_connected:
            self._teleoperator.disconnect()
