"""DuoBench's page as a teleoperator of LeRobot, and its tasks as a robot.

LeRobot's programs import this package because of the name of its distribution, and the import
registers `--teleop.type=duobench` and `--robot.type=duobench`.
"""

from lerobot_teleoperator_duobench.config import DuoBenchRobotConfig, DuoBenchTeleoperatorConfig
from lerobot_teleoperator_duobench.robot import DuoBenchRobot
from lerobot_teleoperator_duobench.steps import LeadArms
from lerobot_teleoperator_duobench.teleoperator import DuoBenchTeleoperator

__all__ = [
    "DuoBenchRobot",
    "DuoBenchRobotConfig",
    "DuoBenchTeleoperator",
    "DuoBenchTeleoperatorConfig",
    "LeadArms",
]
