"""What `--robot.…` chooses."""

from __future__ import annotations

from dataclasses import dataclass

from lerobot.robots import RobotConfig

from duobench.types import POLICY_CAMERAS


@RobotConfig.register_subclass("duobench_duo")
@dataclass(kw_only=True)
class DuoBenchDuoConfig(RobotConfig):
    """Options of the real arms."""

    rig: str = ""
    """File of the rig, `rig.json`, or "simulated" for devices that are computed."""
    # `cameras` would have to hold LeRobot's configurations of cameras.
    views: tuple[str, ...] = POLICY_CAMERAS
    """Cameras of the rig whose images are in an observation; () takes none."""
    image_size: int = 224
    """Side of the images in pixels."""
    ask: bool = True
    """Whether somebody at the terminal has to confirm before anything moves. False is refused for
    anything but a simulated rig."""
    guard: bool = True
    """Whether arms are kept apart, and off the table."""
