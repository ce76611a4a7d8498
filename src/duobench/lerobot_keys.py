"""What LeRobot calls things: columns of a data set, and where a training puts its checkpoint."""

from collections.abc import Mapping
from typing import Any

STATE, ACTION = "observation.state", "action"
"""Proprioception, and the actions."""
OBJECT_STATE = "observation.environment_state"
"""Where the objects are, as numbers."""
IMAGE_PREFIX = "observation.images."
"""What the name of a camera's images begins with."""
DOMAIN = "domain"
"""Column of an export that says where a row is from; the index of one of `DOMAINS`."""
DOMAINS = ("sim", "real")
"""What the numbers 0 and 1 of that column stand for, for mixed training."""
LAST = "checkpoints/last/pretrained_model"
"""The last checkpoint, in the folder of a training."""
STEP = "checkpoints/last/training_state/training_step.json"
"""How many steps it was trained for."""
SUITE = "suite_version"
"""Key of the suite's version, in what `duobench` writes beside a data set and a checkpoint."""
FEATURE_NAMES = "duobench_names.json"
"""File beside a checkpoint that says what the numbers of its features are: names by feature.
LeRobot keeps only how many there are."""
CARD, ID = "README.md", "USER/NAME"
"""The card of a data set or a checkpoint on the Hub, and what stands for an id there."""
POSITION = ".pos"
"""What LeRobot appends to the name of a joint for its position."""
EXECUTED = 30
"""Actions that are executed of each chunk [paper]."""


def feature_names(info: Mapping[str, Any], feature: str) -> list[Any] | None:
    """What the numbers of a feature are, as the `meta/info.json` of a data set says.

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
    return [name.removesuffix(POSITION) if isinstance(name, str) else name for name in names]
