"""Names of LeRobot and the Hub: columns, folders of checkpoints, fields of cards."""

import re
from collections.abc import Mapping
from typing import Any

from duobench.core.errors import OptionError

FORMAT = "v3.0"
"""Version of its data set format that LeRobot 0.6 trains from."""
STATE, ACTION = "observation.state", "action"
"""Proprioception, and the actions."""
OBJECT_STATE = "observation.environment_state"
"""Column of the object state."""
IMAGE_PREFIX = "observation.images."
"""Prefix of the name of a camera's images."""
DEPTH_SUFFIX = "_depth"
"""Ending of the name of a camera's depth, as LeRobot's robots have it."""
DOMAIN = "domain"
"""Column of an export that says where a row is from; the index of one of `DOMAINS`."""
DOMAINS = ("sim", "real")
"""Meaning of the numbers 0 and 1 of that column, for mixed training."""
RECORDING = "recording"
"""Column of the table of episodes that names its file, from the folder of its data set."""
RECORDING_ROW = "recording_row"
"""Column of an export that says which row of its recording a row is."""
LAST = "checkpoints/last/pretrained_model"
"""The last checkpoint, in the folder of a training."""
STEP = "checkpoints/last/training_state/training_step.json"
"""Number of training steps."""
SUITE = "suite_version"
"""Key of the suite's version, in what `duobench` writes beside a data set and a checkpoint."""
ROBOT = "robot"
"""Key there of the gripper and mount of the arms, where they are not the paper's."""
ROBOT_TYPE = "franka_fr3_duo"
"""Kind of the arms in LeRobot; the gripper and mount that are not the paper's follow."""
FEATURE_NAMES = "duobench_names.json"
"""File beside a checkpoint that says what the numbers of its features are: names by feature.
LeRobot keeps only how many there are."""
CARD, ID = "README.md", "USER/NAME"
"""The card of a data set on the Hub, and what stands for an id there."""
_ID = re.compile(
    r"(?!.*(--|\.\.|\.git$))(?=.{1,96}$)\w([\w.-]*\w)?(/\w([\w.-]*\w)?)?", re.ASCII
)
_LICENCE = re.compile(r"[a-z0-9][a-z0-9.+-]*")
POSITION = ".pos"
"""Suffix of the name of a joint for its position."""
EXECUTED = 30
"""Actions that are executed of each chunk [paper]."""


def feature_names(info: Mapping[str, Any], feature: str) -> list[Any] | None:
    """Names of the numbers of a feature, as the `meta/info.json` of a data set says.

    The names may stand under a heading of their own (`{"motors": [...]}`), and come without
    `POSITION`, which LeRobot's robots append; None where nothing is said.
    """
    try:
        names = info["features"][feature]["names"]
    except (KeyError, TypeError):
        return None
    if isinstance(names, Mapping) and len(names) == 1:
        (names,) = names.values()
    if not isinstance(names, list):
        return None
    return [
        name.removesuffix(POSITION) if isinstance(name, str) else name for name in names
    ]


def robot_of(info: Mapping[str, Any]) -> str | None:
    """Gripper and mount that are not the paper's, as a `meta/info.json` says; None if unknown."""
    kind = str(info.get("robot_type"))
    return (
        kind.removeprefix(ROBOT_TYPE).strip() if kind.startswith(ROBOT_TYPE) else None
    )


def check_card(name: str, licence: str) -> None:
    """Refuse what the Hub would refuse once everything is uploaded."""
    if not _ID.fullmatch(name):
        raise OptionError(
            f"A name on the Hub is {ID}, of at most 96 letters, digits and _, with single dots and "
            f"dashes between them; got {name!r}."
        )
    if not _LICENCE.fullmatch(licence):
        raise OptionError(
            "The Hub knows licences by words such as apache-2.0, mit, cc-by-4.0, other; "
            f"got {licence!r}."
        )
