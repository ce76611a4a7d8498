"""What `--teleop.…` and `--robot.…` choose."""

from __future__ import annotations

from dataclasses import dataclass

from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig

from duobench.randomness import TRAIN
from duobench.types import POLICY_CAMERAS


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
    """How they look, as docs/looks.md names it."""
    real_time: bool = True
    """Whether a control step takes at least 1/30 s, whatever LeRobot's program asks for."""
