"""What `--teleop.…` and `--robot.…` choose, and what all robots of these arms have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from lerobot.robots import Robot, RobotConfig
from lerobot.teleoperators import TeleoperatorConfig

from duobench.core.lerobot_keys import POSITION, ROBOT_TYPE
from duobench.core.randomness import TRAIN
from duobench.envs.spaces import JOINT_NAMES
from duobench.world.robot.cameras import POLICY_CAMERAS
from duobench.world.robot.frames import other_robot
from duobench.world.robot.gripper import DEFAULT_GRIPPER
from duobench.world.robot.mounts import DEFAULT_MOUNT

KEYS = tuple(f"{name}{POSITION}" for name in JOINT_NAMES)
"""Names of the numbers of an action: seven joints in radians and a gripper, left then right."""


def by_key(numbers: np.ndarray) -> dict[str, float]:
    """The 16 numbers of both arms by their names, as LeRobot passes them on."""
    return dict(zip(KEYS, numbers.tolist(), strict=True))


@TeleoperatorConfig.register_subclass("duobench")
@dataclass(kw_only=True)
class DuoBenchTeleoperatorConfig(TeleoperatorConfig):
    """Options of the page."""

    port: int = 0
    """Port of the page; 0 takes a free one."""
    lan: bool = False
    """Whether other machines in the network may open the page, which is encrypted then."""
    lockstep: bool = False
    """Whether each action waits for a message of the page, and nothing moves without one: for
    machines that are too slow for real time."""
    gripper: str = DEFAULT_GRIPPER
    """Gripper of the arms that are led, as the robot has it."""
    mount: str = DEFAULT_MOUNT
    """Their mounting."""


@RobotConfig.register_subclass("duobench")
@dataclass(kw_only=True)
class DuoBenchRobotConfig(RobotConfig):
    """Options of the simulated robot."""

    task: str = "transfer_cube"
    """Id of the task that is on the table, or its import path "module:ATTRIBUTE"."""
    split: str = TRAIN
    """Split of the layouts."""
    episode: int = 0
    """Number of the first layout; each keep or discard on the page goes on to the next one."""
    # `cameras` would have to hold LeRobot's configurations of real ones.
    views: tuple[str, ...] = POLICY_CAMERAS
    """Cameras whose images are in an observation; () renders none."""
    image_size: int = 224
    """Side of the images in pixels."""
    look: str = "default"
    """How they look, as the page looks names it."""
    gripper: str = DEFAULT_GRIPPER
    """Gripper on both arms, such as franka_hand, or module:ATTRIBUTE."""
    mount: str = DEFAULT_MOUNT
    """How the arms are mounted: duo or wide."""
    real_time: bool = True
    """Whether a control step takes at least 1/30 s, whatever LeRobot's program asks for."""


@RobotConfig.register_subclass("duobench_duo")
@dataclass(kw_only=True)
class DuoBenchDuoConfig(RobotConfig):
    """Options of the real arms."""

    rig: str = ""
    """File of the rig, `rig.json`, or "rehearsal" for arms that act on a simulation."""
    # `cameras` would have to hold LeRobot's configurations of cameras.
    views: tuple[str, ...] = POLICY_CAMERAS
    """Cameras of the rig whose images are in an observation; () takes none."""
    image_size: int = 224
    """Side of the images in pixels."""
    ask: bool = True
    """Whether somebody at the terminal has to confirm before anything moves. False is refused for
    anything but a rehearsal."""
    guard: bool = True
    """Whether arms are kept apart, and off the table."""


class Arms(Robot):
    """Both arms of an FR3 Duo, with cameras, in the numbers of `KEYS`."""

    name = ROBOT_TYPE

    def __init__(
        self, config: DuoBenchRobotConfig | DuoBenchDuoConfig, gripper: str, mount: str
    ) -> None:
        self.name = f"{ROBOT_TYPE} {other_robot(gripper, mount)}".rstrip()
        super().__init__(config)
        self.config = config
        self.cameras: dict[str, None] = dict.fromkeys(config.views)
        """Names of the cameras; LeRobot asks how many there are."""

    @property
    def observation_features(self) -> dict[str, Any]:
        """The 16 measured numbers, and the images (height, width, 3)."""
        size = (self.config.image_size, self.config.image_size, 3)
        return {**dict.fromkeys(KEYS, float), **dict.fromkeys(self.config.views, size)}

    @property
    def action_features(self) -> dict[str, type]:
        """The 16 numbers of a command."""
        return dict.fromkeys(KEYS, float)

    @property
    def is_calibrated(self) -> bool:
        """Always: cameras are calibrated by `duobench real calibrate`, into the rig's file."""
        return True

    def calibrate(self) -> None:
        """Do nothing; see `is_calibrated`."""

    def configure(self) -> None:
        """Do nothing; the options and the rig's file say everything."""
