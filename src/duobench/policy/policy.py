"""Protocol of a policy: two methods, and its expectations on an environment."""

from __future__ import annotations

from collections.abc import (
    Callable,
    Collection,
    Iterable,
    Iterator,
    Mapping,
)
from dataclasses import dataclass, field
from typing import (
    TYPE_CHECKING,
    Any,
    Protocol,
    runtime_checkable,
)

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duobench.core.backend import DEPTH, SEGMENTATION
from duobench.core.errors import DuoBenchError, PolicyError, escaped
from duobench.core.types import (
    FLAT_SIZE,
    as_count,
    as_several,
    as_size,
    real_array,
)
from duobench.envs.camera_options import CAMERA_OPTIONS, camera_options, name_of
from duobench.world.robot.cameras import POLICY_CAMERAS, Camera
from duobench.world.robot.frames import USUAL_ROBOT

if TYPE_CHECKING:
    import gymnasium as gym

    from duobench.envs.config import EnvConfig

_LONGEST_TEXT = 1000
"""Characters of a name or a version, which tables show."""
_LONGEST_SHOWN = 400
"""Characters of something that is no chunk that an error shows."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyMetadata:
    """Expectations of a policy on the environment that it acts in."""

    name: str
    """Name that the policy gives itself, for people."""
    cameras: tuple[str | Camera, ...] = POLICY_CAMERAS
    """Cameras that must be in the observation; the others are not rendered. All of the
    environment's by default; `()` for a policy that needs no images, which is faster. One of one's
    own is a `Camera` or its JSON form; sizes by camera, as for `duobench.make`, fill
    `image_sizes`."""
    depth: tuple[str, ...] = ()
    """Cameras whose depth must be there: names, or True for all of `cameras`."""
    segmentation: tuple[str, ...] = ()
    """The same for the parts of the scene that pixels show: privileged, as only a simulation
    knows them."""
    object_state: bool = False
    """Whether the observation must hold `environment_state`, the privileged numbers of the
    objects."""
    image_size: tuple[int, int] | None = None
    """Height and width of every image in pixels, given as one number for a square; None takes the
    environment's default."""
    image_sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict, hash=False)
    """Height and width by camera, of those with another size than `image_size`."""
    action_mode: str = "joint"
    """The environment's action mode that the actions are meant for."""
    robot: str | None = None
    """Gripper and mount that it learned with, such as "franka_hand" or "franka_hand wide"; "" for
    those of the paper, None if that is not known. With others it plays too, and is said to."""
    version: str | None = None
    """Version that changes when the policy does, such as the hash of its checkpoint; a run goes on
    only with the version it began with. An evaluation takes the hash of the module's source for
    None."""
    horizon: int | None = None
    """Actions of one chunk; None if that varies or is unknown."""
    batch_invariant: bool = False
    """Whether a chunk has the same bits however large the batch is that it was made in."""
    dtype: str | None = None
    """Numbers that the model computes in, such as "bfloat16"."""
    device: str | None = None
    """Device of the model, such as "cuda" or "cpu"."""

    def __post_init__(self) -> None:
        try:
            given = {name: getattr(self, name) for name in CAMERA_OPTIONS}
            for name, value in camera_options(given).items():
                object.__setattr__(self, name, value)
        except DuoBenchError as error:
            raise PolicyError(f"What a policy sees is invalid: {error}") from error
        for name, convert in _CONVERSIONS.items():
            try:
                object.__setattr__(self, name, convert(getattr(self, name)))
            except (TypeError, ValueError) as error:
                raise PolicyError(
                    f"The {name} of a policy cannot be {getattr(self, name)!r}: {error}."
                ) from error
        for name in ("name", "action_mode", "robot", "version", "dtype", "device"):
            kinds = str if name in {"name", "action_mode"} else str | None
            value = getattr(self, name)
            if not isinstance(value, kinds) or (value and value != escaped(value)):
                raise PolicyError(
                    f"The {name} of a policy is printable text, got {value!a}."
                )
            if value and len(value) > _LONGEST_TEXT:
                raise PolicyError(
                    f"The {name} of a policy has at most {_LONGEST_TEXT} characters, not "
                    f"{len(value)}, as a hash of what it would say."
                )
        for what, kinds in (
            ("cameras", str | Camera),
            (DEPTH, str),
            (SEGMENTATION, str),
        ):
            values = getattr(self, what)
            if not all(isinstance(value, kinds) for value in values):
                raise PolicyError(f"The {what} of a policy are names, got {values!r}.")


def _or_none(
    convert: Callable[[Any], object], expected: str
) -> Callable[[Any], object]:
    def converted(value: Any) -> object:
        result = convert(value)
        if value is not None and result is None:
            raise ValueError(expected)
        return result

    return converted


def _names(value: Any) -> tuple[Any, ...]:
    names = as_several(value)
    if names is None:
        raise TypeError("it is a name, or a list of names")
    return names


_size = _or_none(as_size, "it is (height, width) in pixels, or one number for a square")


def _sizes(value: Any) -> dict[str, object]:
    if not isinstance(value, Mapping):
        raise TypeError("it is sizes by the name of a camera")
    return {name: _size(size) for name, size in value.items()}


_CONVERSIONS: Mapping[str, Callable[[Any], object]] = {
    **dict.fromkeys(("cameras", DEPTH, SEGMENTATION), _names),
    "image_sizes": _sizes,
    "image_size": _size,
    "horizon": _or_none(as_count, "it is at least 1 action"),
    "object_state": bool,
    "batch_invariant": bool,
}
"""Conversions to plain values, which records and messages hold."""
_ASKED = (DEPTH, SEGMENTATION, "image_size", "image_sizes", "object_state")
"""What a policy may ask for beside cameras and action mode."""


@runtime_checkable
class Policy(Protocol):
    """Anything that turns observations into chunks of actions.

    A policy that holds something, such as a connection or helper processes, may also have a method
    `close()`, which an evaluation calls at its end.
    """

    @property
    def metadata(self) -> PolicyMetadata:
        """Expectations of the policy on the environment."""
        ...

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode and forget the last one.

        Args:
            instruction: What to do, in words.
            seed: Seed of all that the policy samples, which follows from it alone. It is a hash of
                the seed of the layout: an environment that is reset with it shows another one.
        """

    def act(self, observation: Mapping[str, Any]) -> ArrayLike:
        """Decide on the next actions.

        Args:
            observation: The environment's observation: `agent_pos` (16,), `tcp_pose` (14,),
                `pixels` with one HWC uint8 image per camera, and where the metadata ask for them
                `depth` and `segmentation` with one (H, W) image per camera, float32 in metres and
                int32, and `environment_state` (n,).

        Returns:
            Actions (H, n) with H at least 1, executed in order before the next call; n is 16 in
            joint mode: left joints 1-7 in radians, left opening 0..1, then the same on the right.
        """
        ...


def dimensions(actions: ArrayLike) -> int:
    """Number of dimensions of actions; 0 for a value that is no array."""
    try:
        return np.ndim(actions)
    except ValueError:  # rows of several lengths
        return 0


def as_chunk(actions: ArrayLike, width: int | None = FLAT_SIZE) -> NDArray[np.float32]:
    """Check the actions that a policy returned; return a copy.

    Args:
        actions: What `Policy.act` returned.
        width: Numbers of one action; None takes any.

    Returns:
        Array (H, width) of float32, as every action space has it, with H at least 1: what is
        executed is what a recording can hold, also where a policy computes in float64.

    Raises:
        PolicyError: If the shape is another one, or a number is NaN or infinite.
    """
    try:
        with np.errstate(
            over="ignore"
        ):  # too large is infinite, which is rejected below
            chunk = real_array(actions, np.float32).copy()
    except (TypeError, ValueError, OverflowError) as error:
        raise PolicyError(
            f"A policy returns an array of numbers, got {actions!r:.{_LONGEST_SHOWN}} "
            f"({error!s:.{_LONGEST_SHOWN}})."
        ) from None
    expected = "n" if width is None else width
    if chunk.ndim != 2 or chunk.shape[0] < 1 or width not in (None, chunk.shape[1]):  # noqa: PLR2004 - (H, n)
        raise PolicyError(
            f"A policy returns a chunk of actions of shape (H, {expected}) with H at least 1, got "
            f"{chunk.shape}. A single action is a chunk of one: actions[None, :]."
        )
    if not np.isfinite(chunk).all():
        row, column = map(int, np.argwhere(~np.isfinite(chunk))[0])
        raise PolicyError(
            f"A policy returned {chunk[row, column]} in action {row} of its chunk, number {column}."
        )
    return chunk


def check_fits(metadata: PolicyMetadata, env: gym.Env) -> None:
    """Reject a policy that expects another environment.

    Args:
        metadata: What the policy expects.
        env: The environment that it would act in, in any wrappers.

    Raises:
        PolicyError: If the environment's configuration differs from what the policy expects; the
            message lists all of it, and how to make an environment that fits.
    """
    try:
        config = env.get_wrapper_attr("config")
    except AttributeError:
        config = None
    if config is None:
        raise PolicyError(
            "This environment has no configuration to compare with. Make it with duobench.make, or "
            "set `env.unwrapped.config` to a duobench.envs.config.EnvConfig."
        )
    problems = [*_differences(metadata, config)]
    if problems:
        wanted = "".join(
            f", {name}={value!r}"
            for name in _ASKED
            if (value := getattr(metadata, name))
        )
        raise PolicyError(
            f"Policy {metadata.name!r} does not fit the environment: {'; '.join(problems)}. One "
            f"that fits: duobench.make(task, cameras={metadata.cameras}{wanted}, "
            f"action_mode={metadata.action_mode!r})."
        )


def robot_note(metadata: PolicyMetadata, config: EnvConfig) -> str:
    """A sentence on a policy that learned with another gripper or mount; empty for any other."""
    learned, plays = metadata.robot, config.other_robot
    if learned in (None, plays):
        return ""
    return (
        f"The policy learned with {learned or USUAL_ROBOT}, and plays with "
        f"{plays or USUAL_ROBOT}."
    )


def _differences(metadata: PolicyMetadata, config: EnvConfig) -> Iterator[str]:
    yield from _unseen("", metadata.cameras, config.cameras)
    for kind in (DEPTH, SEGMENTATION):
        yield from _unseen(
            f"{kind} of ", getattr(metadata, kind), getattr(config, kind)
        )
    yield from _other_sizes(metadata, config)
    if metadata.object_state and not config.object_state:
        yield "it reads the state of the objects, which the environment does not show"
    if config.flat_obs:
        yield "it reads nested observations, the environment's are flat (flat_obs)"
    if metadata.action_mode != config.action_mode:
        yield f"its actions are {metadata.action_mode!r}, the environment's {config.action_mode!r}"
    if config.chunk is not None:
        yield "it gives chunks of any length, the environment takes chunks of one length"


def _other_sizes(metadata: PolicyMetadata, config: EnvConfig) -> Iterator[str]:
    """Sizes of images, of any kind, that a policy sees and an environment shows in others."""
    shown = {
        name_of(camera): size
        for sizes in config.wanted.values()
        for camera, size in sizes.items()
    }
    own = {
        each.name: each.size for each in metadata.cameras if isinstance(each, Camera)
    }
    differing: dict[str, list[str]] = {}
    seen = (*map(name_of, metadata.cameras), *metadata.depth, *metadata.segmentation)
    for name in dict.fromkeys(seen):
        usual = own.get(name) or metadata.image_size
        size, found = metadata.image_sizes.get(name, usual), shown.get(name)
        if size and found and size != found:
            what = f"it sees images of {size}, the environment's are {found}"
            differing.setdefault(what, []).append(name)
    for what, names in differing.items():
        yield f"{what} ({', '.join(names)})"


def _unseen(
    what: str, wanted: Iterable[str | Camera], shown: Collection[str | Camera]
) -> Iterator[str]:
    """Cameras, or something of cameras, that a policy sees and an environment does not show."""
    names = ", ".join(map(name_of, shown)) or "none"
    for camera in wanted:
        if camera not in shown:
            name = name_of(camera)
            other = (
                ", elsewhere or with another lens" if name in names.split(", ") else ""
            )
            yield f"it sees {what}camera {name!r}, the environment shows {what}{names}{other}"
