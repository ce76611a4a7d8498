"""The real FR3 Duo as a robot of LeRobot.

LeRobot's programs import this package because of the name of its distribution, and the import
registers `--robot.type=duobench_duo`.
"""

from lerobot_robot_duobench.config import DuoBenchDuoConfig
from lerobot_robot_duobench.duo import DuoBenchDuo

__all__ = ["DuoBenchDuo", "DuoBenchDuoConfig"]
