"""LeRobot checkpoint: its name, files, inputs and actions, read without torch."""

import difflib
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from duobench.core import lerobot_keys
from duobench.core.errors import PolicyError, check_known
from duobench.core.files import digest_of, read_object
from duobench.core.lerobot_keys import (
    ACTION,
    DOMAINS,
    FEATURE_NAMES,
    IMAGE_PREFIX,
    LAST,
    OBJECT_STATE,
    ROBOT,
    STATE,
    SUITE,
    feature_names,
)
from duobench.core.randomness import SUITE_VERSION
from duobench.core.types import FLAT_SIZE
from duobench.envs import action_labels, state_labels
from duobench.envs.action_labels import LABELS, ActionLabels
from duobench.envs.action_modes import JOINT
from duobench.envs.state_labels import StatePart
from duobench.world.robot.cameras import POLICY_CAMERAS

CONFIG = "config.json"
WEIGHTS = "model.safetensors"
PROCESSORS = ("policy_preprocessor.json", "policy_postprocessor.json")
ADAPTER = "adapter_config.json"
"""File of low-rank adapters, in place of the weights."""
_TRAINING = "train_config.json"
"""File of LeRobot's trainer beside a checkpoint: it names the data set, and does not change how the
policy acts."""
_EMPTY = f"{IMAGE_PREFIX}empty_camera_"
"""Beginning of the names of placeholder images, which a model fills itself."""
GROOT = "groot"
"""GR00T N1.7, whose model executes no more than `n_action_steps` of its chunk."""
CHUNKED = ("act", GROOT, "pi0", "pi05", "smolvla", "xvla")
"""Kinds of policies that predict `chunk_size` actions from one observation."""
DIFFUSION = "diffusion"
"""Kind of policy whose input is the last `n_obs_steps` observations."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Address:
    """Parts of `lerobot:PATH_OR_ID?steps=30&device=cpu&dtype=float32`."""

    checkpoint: str
    """Folder of a checkpoint, or its id on the Hub."""
    steps: int | None = None
    """Actions executed of each chunk; None takes 30, or the whole chunk if it is shorter."""
    device: str | None = None
    """Device of the model, as torch names it; None takes the best available one."""
    dtype: str | None = None
    """Numbers of the weights, "float32" or "bfloat16"; None takes those of the checkpoint."""
    action: str | None = None
    """Action mode, as an export names it; None takes the mode that the names of the actions in its
    data set belong to."""
    domain: str = DOMAINS[0]
    """Domain in which it plays, "sim" or "real"; for a policy that learned with domain ids."""


def parse(text: str) -> Address:
    """Parse the text after `lerobot:`: a folder or an id, optionally followed by `?` and options.

    Example:
        >>> parse("runs/act/checkpoints/last/pretrained_model?steps=10").steps
        10
    """
    checkpoint, _, query = text.partition("?")
    if not checkpoint:
        raise PolicyError(
            "A LeRobot policy is lerobot:PATH_OR_ID, the folder of a checkpoint or its id on the "
            "Hub, such as lerobot:runs/act/checkpoints/last/pretrained_model."
        )
    known = [field.name for field in fields(Address) if field.name != "checkpoint"]
    options: dict[str, str] = {}
    for name, value in parse_qsl(query, keep_blank_values=True):
        check_known("option of a LeRobot policy", name, known)
        if not value or name in options:
            raise PolicyError(
                f"Option {name!r} of a LeRobot policy needs one value: {text!r}."
            )
        options[name] = value
    steps = options.pop("steps", None)
    if steps is not None and not (
        steps.isascii() and steps.isdigit() and int(steps) > 0
    ):
        raise PolicyError(
            f"The steps of a LeRobot policy are 1 or more, got {steps!r}."
        )
    check_known("domain", options.get("domain", DOMAINS[0]), DOMAINS)
    return Address(
        checkpoint=checkpoint, steps=None if steps is None else int(steps), **options
    )


def find(checkpoint: str) -> Path:
    """Return the folder of a checkpoint, given as a path or as an id `user/name` on the Hub.

    Raises:
        PolicyError: There is no such checkpoint, or it cannot be played.
    """
    path = Path(checkpoint).expanduser()
    folder = path if path.is_dir() else _downloaded(checkpoint)
    if (folder / ADAPTER).exists():
        raise PolicyError(
            f"{checkpoint} holds adapters alone ({ADAPTER}); merge them into the weights of the "
            "base and save the whole policy."
        )
    missing = [name for name in (CONFIG, WEIGHTS) if not (folder / name).exists()]
    if missing:
        last = folder / LAST
        hint = f" Did you mean {Path(checkpoint) / LAST}?" if last.is_dir() else ""
        raise PolicyError(
            f"{checkpoint} is no LeRobot policy: no {', '.join(missing)}.{hint}"
        )
    suite = read(folder / FEATURE_NAMES).get(SUITE)
    if suite not in (None, SUITE_VERSION):
        raise PolicyError(
            f"{checkpoint} was trained on suite {suite}; this version plays suite {SUITE_VERSION}, "
            "whose episodes and scores are others. Train it again."
        )
    missing = [name for name in PROCESSORS if not (folder / name).exists()]
    if missing:
        raise PolicyError(
            f"{checkpoint} has no {', '.join(missing)}: it was saved by an older LeRobot. Convert "
            "it with LeRobot's module lerobot.processor.migrate_policy_normalization."
        )
    return folder


def _downloaded(checkpoint: str) -> Path:
    is_id = checkpoint.count("/") == 1 and not checkpoint.startswith((".", "/", "~"))
    if not is_id:
        raise PolicyError(
            f"There is no folder {checkpoint}, and it is no id on the Hub, which is user/name."
        )
    from huggingface_hub import snapshot_download  # pyright: ignore[reportMissingImports]

    try:
        return Path(
            snapshot_download(checkpoint, allow_patterns=["*.json", "*.safetensors"])
        )
    except (OSError, ValueError) as error:  # the errors of its connections are OSErrors
        raise PolicyError(
            f"There is no folder {checkpoint}, and no checkpoint of that id was downloaded: {error}"
        ) from error


def content_hash(folder: Path) -> str:
    """SHA-256 over the names and contents of configuration, weights and processors."""
    digest = hashlib.sha256()
    for path in sorted(folder.iterdir(), key=lambda path: path.name):
        if path.suffix in {".json", ".safetensors"} and path.name != _TRAINING:
            digest.update(f"{path.name} {digest_of(path)}\n".encode())
    return digest.hexdigest()


def read(path: Path) -> Mapping[str, Any]:
    """Read a JSON object from a file; a missing file is an empty object."""
    return read_object(path, PolicyError) or {}


def inputs(config: Any, rename_map: Mapping[str, str]) -> dict[str, tuple[int, int]]:
    """Height and width of a checkpoint's images by camera, in names of this benchmark.

    Args:
        config: Its configuration, LeRobot's `PreTrainedConfig`.
        rename_map: From names of the environment to names in the checkpoint.
    """
    _check_vectors(config)
    original = {new: old for old, new in rename_map.items()}
    shapes: dict[str, tuple[int, int]] = {}
    for key, feature in config.image_features.items():
        if not key.startswith(_EMPTY):
            _, height, width = feature.shape
            shapes[original.get(str(key), str(key))] = height, width
    known = [IMAGE_PREFIX + name for name in POLICY_CAMERAS]
    problems = [_with_near_miss(key) for key in shapes if key not in known]
    if problems:
        raise PolicyError(
            f"The checkpoint sees {'; '.join(problems)}. The cameras are "
            f"{', '.join(known)}: train with these names, or with LeRobot's rename_map from them, "
            "which is saved in the checkpoint."
        )
    return {key.removeprefix(IMAGE_PREFIX): size for key, size in shapes.items()}


def horizon(config: Any) -> int:
    """Number of actions that a checkpoint predicts from the current observation on."""
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
    # `chunk_size`, or less where a base of GR00T has less.
    return len(config.action_delta_indices)


def _check_vectors(config: Any) -> None:
    known = {STATE, OBJECT_STATE, *config.image_features}
    other = sorted(set(config.input_features or {}) - known)
    if other:
        raise PolicyError(
            f"The checkpoint also sees {', '.join(other)}; there are only {STATE}, {OBJECT_STATE} "
            "and images."
        )


def state_parts(folder: Path, config: Any) -> tuple[StatePart, ...]:
    """Parts of a checkpoint's state that follow joint positions and gripper openings.

    They are found by the names of its numbers; 16 numbers are joints and openings alone.
    """
    state = config.robot_state_feature
    if state is None or tuple(state.shape) == (FLAT_SIZE,):
        return ()
    names = _names(folder, STATE)
    parts = None if names is None else state_labels.find(names)
    if parts is None or tuple(state.shape) != (len(state_labels.names_of(parts)),):
        raise PolicyError(
            f"The checkpoint's {STATE} has shape {tuple(state.shape)}, this benchmark's "
            f"({FLAT_SIZE},): seven joints and the gripper of the left arm, then of the right one; "
            f"tool poses may follow where {FEATURE_NAMES} or its data set names them."
        )
    hidden = [part for part in parts if part not in state_labels.SHOWN]
    if hidden:
        raise PolicyError(
            f"The checkpoint's {STATE} holds {', '.join(hidden)}, which no environment shows; "
            f"train on an export with {', '.join(state_labels.SHOWN)} at most."
        )
    return parts


def object_numbers(config: Any) -> int:
    """Number of values of the object state that a checkpoint takes; 0 if it takes none."""
    feature = (config.input_features or {}).get(OBJECT_STATE)
    return 0 if feature is None else int(feature.shape[0])


def _with_near_miss(key: str) -> str:
    near = difflib.get_close_matches(
        key.removeprefix(IMAGE_PREFIX), POLICY_CAMERAS, n=1
    )
    if not near:
        return repr(key)
    return f"{key!r} (did you mean {IMAGE_PREFIX}{near[0]}?)"


def labels_of(
    folder: Path,
    size: int,
    mode: str | None = None,
) -> ActionLabels:
    """Labels of the `size` numbers of a checkpoint's actions.

    A given mode decides. Otherwise their names do, which `duobench train` writes beside the
    checkpoint; without that file they are read from the data set, if it is still in its place.
    Sixteen numbers without names are joint targets.
    """
    if mode is not None:
        check_known("action mode of an export", mode, LABELS)
        labels = LABELS[mode]
        source = f"mode {mode!r}"
    else:
        labels = _named_labels(folder, size)
        source = "its data set"
    if len(labels.names) != size:
        raise PolicyError(
            f"The checkpoint's actions have {size} numbers, those of {source} "
            f"{len(labels.names)}: {', '.join(labels.names)}."
        )
    return labels


def _named_labels(folder: Path, size: int) -> ActionLabels:
    """Labels that the names of a checkpoint's actions belong to."""
    names = _names(folder, ACTION)
    if names is None:
        if size == len(JOINT.names):
            return LABELS[JOINT.name]
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
    return labels


def _names(folder: Path, feature: str) -> list[Any] | None:
    beside = read(folder / FEATURE_NAMES)
    return beside.get(feature) if beside else feature_names(_data(folder), feature)


def robot_of(folder: Path) -> str | None:
    """Gripper and mount that a checkpoint learned with, as `PolicyMetadata` has them."""
    beside = read(folder / FEATURE_NAMES)
    return beside.get(ROBOT) if beside else lerobot_keys.robot_of(_data(folder))


def _data(folder: Path) -> Mapping[str, Any]:
    """Return what is known of the data set of a checkpoint, if it is still in its place."""
    dataset = read(folder / _TRAINING).get("dataset")
    root = dataset.get("root") if isinstance(dataset, Mapping) else None
    return read(Path(root) / "meta/info.json") if isinstance(root, str) else {}
