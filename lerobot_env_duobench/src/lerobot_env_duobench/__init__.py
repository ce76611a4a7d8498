"""DuoBench's tasks as environments of LeRobot: `--env.type=duobench`.

LeRobot's programs import this package because of the name of its distribution, and the import
registers everything.
"""

from lerobot_env_duobench.config import DuoBenchEnv
from lerobot_env_duobench.domain import pass_domains_on

pass_domains_on()

__all__ = ["DuoBenchEnv"]
