"""What the numbers of a checkpoint's actions are: by the names in the data set it learned from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from duobench.envs import action_labels
from duobench.envs.action_labels import LABELS, ActionLabels
from duobench.envs.action_modes import JOINT
from duobench.errors import PolicyError, check_known
from duobench.lerobot_keys import ACTION, FEATURE_NAMES, feature_names
from duobench.policy.lerobot.checkpoint import read

_TRAINING = "train_config.json"
"""What LeRobot's trainer saves with a checkpoint; it says where the data set was."""


def labels_of(folder: Path, size: int, mode: str | None = None) -> ActionLabels:
    """What the numbers of a checkpoint's actions are.

    Their names stand beside the checkpoint, where `duobench train` writes them, or else in the
    data set, as long as it is where it was. Sixteen numbers without names are joint targets.

    Args:
        folder: The folder of the checkpoint.
        size: How many numbers an action has.
        mode: The mode that they are meant for, whatever the names say.

    Raises:
        PolicyError: They are not known, or are not as many.
        UnknownNameError: There is no such mode of labels.
    """
    if mode is not None:
        check_known("action mode of an export", mode, LABELS)
        return _checked(LABELS[mode], size, f"mode {mode!r}")
    names = _names(folder)
    if names is None and size == len(JOINT.names):
        return LABELS[JOINT.name]
    if names is None:
        raise PolicyError(
            f"The checkpoint's actions have {size} numbers, and nothing says what they are: there "
            f"is no {FEATURE_NAMES} in {folder}, and no data set where {_TRAINING} says. Name the "
            "mode, as in lerobot:PATH?action=cartesian."
        )
    labels = action_labels.find(names)
    if labels is None:
        raise PolicyError(
            f"The checkpoint's actions are {', '.join(map(str, names))}, which no action mode has. "
            "If they are the numbers of one under other names, say which, as in "
            "lerobot:PATH?action=joint."
        )
    return _checked(labels, size, "its data set")


def _checked(labels: ActionLabels, size: int, source: str) -> ActionLabels:
    if len(labels.names) != size:
        raise PolicyError(
            f"The checkpoint's actions have {size} numbers, those of {source} "
            f"{len(labels.names)}: {', '.join(labels.names)}."
        )
    return labels


def _names(folder: Path) -> list[Any] | None:
    beside = read(folder / FEATURE_NAMES)
    if beside:
        return beside.get(ACTION)
    dataset = read(folder / _TRAINING).get("dataset")
    root = dataset.get("root") if isinstance(dataset, Mapping) else None
    if not isinstance(root, str):
        return None
    return feature_names(read(Path(root) / "meta/info.json"), ACTION)
