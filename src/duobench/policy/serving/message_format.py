"""Message formats: names, orders and shapes in the messages of foreign policy servers.

A format is data, a TOML file. Keys of a server that lie in maps inside each other are written with
dots between them: `images.cam_high`.
"""

import tomllib
from collections.abc import (
    Collection,
    Iterable,
    Mapping,
    Sequence,
)
from dataclasses import dataclass, field, fields
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import ServingError, UnknownNameError, check_known
from duobench.core.files import read_text, reading
from duobench.core.types import ARM_JOINTS, SIDE_SIZE
from duobench.envs import action_modes
from duobench.policy.batch import Chunk, Observation
from duobench.policy.policy import PolicyMetadata, as_chunk, dimensions

_PACKAGE = "duobench.policy.serving"
FORMATS = ("aloha", "droid", "libero", "vla_eval", "vlagents")
"""Message formats that come with the package."""
_PARTS: tuple[str, ...] = ("left_arm", "left_gripper", "right_arm", "right_gripper")
"""Parts of a state and of an action, in our order."""
_GRIPPERS: tuple[str, ...] = ("left_gripper", "right_gripper")
_POSES: tuple[str, ...] = ("left_pose", "right_pose")
"""Further parts of a state: tool poses, x y z qx qy qz qw."""
_RATIO = 9 / 16
"""Height over width of what a camera sees."""
Gripper = Literal["open_is_one", "closed_is_one", "closed_is_one_open_is_minus_one"]
"""Meanings of the numbers of a gripper to a server."""
_OPENINGS: dict[str, tuple[float, float]] = {
    "open_is_one": (0.0, 1.0),
    "closed_is_one": (1.0, -1.0),
    "closed_is_one_open_is_minus_one": (0.5, -0.5),
}
"""The opening at the server's 0, and how much the server's 1 adds to it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ActionFormat:
    """Form in which a server gives actions."""

    key: str = "actions"
    """Name of the chunk in a reply."""
    order: tuple[str, ...] = _PARTS
    """Parts of an action."""
    mode: str = "joint"
    """The environment's action mode that they are meant for."""
    gripper: Gripper | None = None
    """Meaning of the numbers of a gripper in actions; None takes that in states."""

    def __post_init__(self) -> None:
        action_modes.get(self.mode)
        if sorted(self.order) != sorted(_PARTS):
            _check_names("part of an action", self.order, _PARTS)
            raise ServingError(
                f"The parts of an action are {', '.join(_PARTS)}, each once; got "
                f"{', '.join(self.order)}."
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class MessageFormat:
    """Format of a server's messages."""

    images: Mapping[str, str] = field(default_factory=dict)
    """Their key: our camera."""
    image_order: Literal["hwc", "chw"] = "hwc"
    """Whether the three channels come last or first."""
    image_size: tuple[int, int] = (224, 224)
    """Height and width of an image in pixels."""
    resize: Literal["squash", "letterbox"] = "squash"
    """How what a camera sees becomes an image of that size: all of it squashed, as in the paper's
    data, or with its own ratio between black bars."""
    state: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Their key: parts of the state, joined in this order."""
    prompt: str = "prompt"
    """Their key for the instruction."""
    gripper: Gripper = "open_is_one"
    """Meaning of the numbers of a gripper in states."""
    actions: ActionFormat = field(default_factory=ActionFormat)
    """Form of the actions."""

    def __post_init__(self) -> None:
        for key, parts in self.state.items():
            _check_names("part of a state", parts, (*_PARTS, *_POSES))
            if not parts:
                raise ServingError(f"The state {key!r} has no parts.")
        _check_keys([*self.images, *self.state, self.prompt])
        if min(self.image_size) < 1 or (self.resize == "letterbox" and self.bars < 0):
            raise ServingError(
                f"Images of {self.image_size} cannot be made by {self.resize}; a letterbox needs a "
                "height of at least 9/16 of the width."
            )

    @property
    def rendered_size(self) -> tuple[int, int]:
        """Height and width of the images that are rendered, before bars are added."""
        height, width = self.image_size
        return (
            (round(width * _RATIO), width)
            if self.resize == "letterbox"
            else (height, width)
        )

    @property
    def bars(self) -> int:
        """Rows that are added to a rendered image."""
        return self.image_size[0] - self.rendered_size[0]

    def metadata(self, name: str, version: str) -> PolicyMetadata:
        """Expectations of a policy with this format on the environment."""
        return PolicyMetadata(
            name=name,
            version=version,
            cameras=tuple(dict.fromkeys(self.images.values())),
            image_size=self.rendered_size if self.images else None,
            action_mode=self.actions.mode,
        )

    def request(self, observation: Observation, instruction: str) -> dict[str, Any]:
        """An observation as the server expects it."""
        request: dict[str, Any] = {}
        for key, camera in self.images.items():
            _put(request, key, self._image(observation["pixels"][camera]))
        parts = _parts_of(observation, self.gripper)
        for key, names in self.state.items():
            _put(request, key, np.concatenate([parts[name] for name in names]))
        _put(request, self.prompt, instruction)
        return request

    @property
    def action_sizes(self) -> dict[str, int]:
        """Sizes of the parts of an action, in the server's order."""
        arm = action_modes.get(self.actions.mode).arm_size
        return {
            part: 1 if part.endswith("gripper") else arm for part in self.actions.order
        }

    @property
    def state_sizes(self) -> dict[str, int]:
        """Sizes of states, by key."""
        return {
            key: sum(1 if part.endswith("gripper") else ARM_JOINTS for part in parts)
            for key, parts in self.state.items()
        }

    def chunk(self, actions: Any) -> Chunk:
        """Convert a server's actions (H, n) to ours; an error if they do not have this format."""
        sizes = self.action_sizes
        if dimensions(actions) == 3 and len(actions) == 1:  # noqa: PLR2004 - a batch of one chunk
            actions = actions[0]
        *ends, width = np.cumsum([*sizes.values()])
        columns = np.split(as_chunk(actions, width), ends, axis=1)
        parts = dict(zip(sizes, columns, strict=True))
        at_zero, at_one = _OPENINGS[self._action_gripper]
        for name in _GRIPPERS:
            parts[name] = at_zero + at_one * parts[name]
        return np.concatenate([parts[part] for part in _PARTS], axis=1)

    def measured_action(self, observation: Observation) -> NDArray[np.float32]:
        """Measured state of the arms as an action (n,) that the server would give."""
        parts = _parts_of(observation, self._action_gripper)
        if self.actions.mode.startswith("cartesian"):
            parts["left_arm"], parts["right_arm"] = (parts[pose] for pose in _POSES)
        return np.concatenate(
            [parts[part][:size] for part, size in self.action_sizes.items()]
        )

    def _image(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        if self.bars:
            above = self.bars // 2
            image = np.pad(image, ((above, self.bars - above), (0, 0), (0, 0)))
        return (
            image
            if self.image_order == "hwc"
            else np.ascontiguousarray(image.transpose(2, 0, 1))
        )

    @property
    def _action_gripper(self) -> Gripper:
        return self.actions.gripper or self.gripper


def _parts_of(
    observation: Observation, gripper: Gripper
) -> dict[str, NDArray[np.float32]]:
    """Parts of the state by their names, with the server's numbers of grippers."""
    flat = np.asarray(observation["agent_pos"], dtype=np.float32)
    numbers = np.split(flat, [ARM_JOINTS, SIDE_SIZE, SIDE_SIZE + ARM_JOINTS])
    poses = np.split(np.asarray(observation["tcp_pose"], dtype=np.float32), 2)
    parts = dict(zip((*_PARTS, *_POSES), (*numbers, *poses), strict=True))
    at_zero, at_one = _OPENINGS[gripper]
    for name in _GRIPPERS:
        parts[name] = (parts[name] - at_zero) / at_one
    return parts


def read_format(name: str) -> MessageFormat:
    """One of `FORMATS`, or a format from a file that ends in `.toml`; errors say what is wrong."""
    if name in FORMATS:
        path = files(_PACKAGE).joinpath("formats", f"{name}.toml")
    elif name.endswith(".toml"):
        path = Path(name)
    else:
        raise UnknownNameError("format", name, [*FORMATS, "FILE.toml"])
    with reading(f"the format {name}", ServingError):
        return _decoded(name, tomllib.loads(read_text(path)))


def _decoded(name: str, document: dict[str, Any]) -> MessageFormat:
    _check_names(
        "key of a format", document, [each.name for each in fields(MessageFormat)]
    )
    actions = document.get("actions")
    if isinstance(actions, dict):
        known = [each.name for each in fields(ActionFormat)]
        _check_names("key of a format's actions", actions, known)
    try:
        return msgspec.convert(document, MessageFormat)
    except msgspec.ValidationError as error:
        raise ServingError(
            f"The format {name} is invalid: {error}.".replace("`$.", "`")
        ) from error


def _check_names(
    kind: str,
    names: Iterable[str],
    known: Collection[str],
) -> None:
    for name in names:
        check_known(kind, name, known)


def _put(
    request: dict[str, Any],
    key: str,
    value: object,
) -> None:
    """Put a value where a key with dots says."""
    *above, last = key.split(".")
    for name in above:
        request = request.setdefault(name, {})
    request[last] = value


def _check_keys(keys: Sequence[str]) -> None:
    """Reject keys that are the same, or of which one is a map that holds another."""
    for key in keys:
        if keys.count(key) > 1 or any(other.startswith(f"{key}.") for other in keys):
            raise ServingError(
                f"The format puts several things at {key!r}; images, states and the prompt have a "
                "place each."
            )
