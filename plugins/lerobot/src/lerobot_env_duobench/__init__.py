"""DuoBench in LeRobot's programs: its tasks, its page and its real arms.

LeRobot imports this package because of the name of its distribution. The import registers
`--env.type=duobench`, `--teleop.type=duobench`, `--robot.type=duobench` and
`--robot.type=duobench_duo`. Devices themselves are imported when one is made, so that an evaluation
loads no drivers and no page.
"""

from importlib import import_module

from lerobot_env_duobench.config import (
    DuoBenchDuoConfig,
    DuoBenchRobotConfig,
    DuoBenchTeleoperatorConfig,
)
from lerobot_env_duobench.environments import DuoBenchEnv
from lerobot_env_duobench.processors import LeadArms, pass_domains_on

pass_domains_on()

_DEVICES = {
    "DuoBenchDuo": "duo",
    "DuoBenchRobot": "robot",
    "DuoBenchTeleoperator": "teleoperator",
}
"""Modules of the devices, by their classes, which LeRobot asks this package for."""

__all__ = [
    "DuoBenchDuo",
    "DuoBenchDuoConfig",
    "DuoBenchEnv",
    "DuoBenchRobot",
    "DuoBenchRobotConfig",
    "DuoBenchTeleoperator",
    "DuoBenchTeleoperatorConfig",
    "LeadArms",
]


def __getattr__(name: str) -> type:
    """Import a device at its first use."""
    if name not in _DEVICES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_DEVICES[name]}"), name)
