"""What a checkpoint sees and controls, checked against what this benchmark has."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

from duobench.errors import PolicyError
from duobench.lerobot_keys import IMAGE_PREFIX, OBJECT_STATE, STATE
from duobench.types import FLAT_SIZE, POLICY_CAMERAS

_EMPTY = f"{IMAGE_PREFIX}empty_camera_"
"""Placeholders that a model fills itself."""
CHUNKED = ("act", "pi0", "pi05", "smolvla", "xvla")
"""Kinds of policies that predict `chunk_size` actions from one observation."""
DIFFUSION = "diffusion"
"""The kind that sees the last `n_obs_steps` observations."""


def inputs(
    config: Any, rename_map: Mapping[str, str]
) -> tuple[tuple[str, ...], tuple[int, int] | None]:
    """What a checkpoint sees, in the names of this benchmark.

    Args:
        config: Its configuration, LeRobot's `PreTrainedConfig`.
        rename_map: From names of the environment to names in the checkpoint, as its processor has
            it.

    Returns:
        Cameras of the environment, each shown as `observation.images.<camera>`; height and width of
        their images, None without cameras.

    Raises:
        PolicyError: It sees or controls what this benchmark does not have.
    """
    _check_vectors(config)
    original = {new: old for old, new in rename_map.items()}
    shapes: dict[str, tuple[int, int]] = {}
    for key, feature in config.image_features.items():
        if not key.startswith(_EMPTY):
            _, height, width = feature.shape
            shapes[original.get(str(key), str(key))] = height, width
    problems = [problem for key in shapes if (problem := _camera_problem(key))]
    if problems:
        raise PolicyError(
            f"The checkpoint sees {'; '.join(problems)}. The cameras are "
            f"{', '.join(IMAGE_PREFIX + name for name in POLICY_CAMERAS)}: train with these names, "
            "or with LeRobot's rename_map from them, which is saved in the checkpoint."
        )
    sizes = set(shapes.values())
    if len(sizes) > 1:
        listed = ", ".join(f"{key} {h}x{w}" for key, (h, w) in shapes.items())
        raise PolicyError(f"All images have one size here; the checkpoint's differ: {listed}.")
    return tuple(key.removeprefix(IMAGE_PREFIX) for key in shapes), next(iter(sizes), None)


def horizon(config: Any) -> int:
    """Actions that a checkpoint predicts, from the current observation on.

    Raises:
        PolicyError: It is of a kind that is not supported, or must act at every step.
    """
    if getattr(config, "temporal_ensemble_coeff", None) is not None:
        raise PolicyError(
            "The checkpoint averages overlapping chunks (temporal_ensemble_coeff), which must be "
            "called at every step; chunks are executed here. To execute them as they are, set it "
            "to null in the checkpoint's config.json."
        )
    if config.type == DIFFUSION:
        return config.horizon - config.n_obs_steps + 1
    if config.type not in CHUNKED:
        raise PolicyError(
            f"A LeRobot policy of type {config.type!r} is not supported; "
            f"{', '.join(sorted((*CHUNKED, DIFFUSION)))} are."
        )
    return config.chunk_size


def _check_vectors(config: Any) -> None:
    known = {STATE, OBJECT_STATE, *config.image_features}
    if other := sorted(set(config.input_features or {}) - known):
        raise PolicyError(
            f"The checkpoint also sees {', '.join(other)}; there are only {STATE}, {OBJECT_STATE} "
            "and images."
        )
    state = config.robot_state_feature
    if state is not None and tuple(state.shape) != (FLAT_SIZE,):
        raise PolicyError(
            f"The checkpoint's {STATE} has shape {tuple(state.shape)}, this benchmark's "
            f"({FLAT_SIZE},): seven joints and the gripper of the left arm, then of the right one."
        )


def object_numbers(config: Any) -> int:
    """How many numbers of objects a checkpoint sees; 0 where it sees none."""
    feature = (config.input_features or {}).get(OBJECT_STATE)
    return 0 if feature is None else int(feature.shape[0])


def _camera_problem(key: str) -> str | None:
    """What is wrong with the name of images, with a near miss; None if they exist."""
    name = key.removeprefix(IMAGE_PREFIX)
    if key != name and name in POLICY_CAMERAS:
        return None
    near = difflib.get_close_matches(name, POLICY_CAMERAS, n=1)
    return f"{key!r}" + "".join(f" (did you mean {IMAGE_PREFIX}{camera}?)" for camera in near)
