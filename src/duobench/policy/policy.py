"""Protocol of a policy: two methods, and its expectations on an environment."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duobench.core.errors import PolicyError, escaped
from duobench.core.types import (
    FLAT_SIZE,
    as_count,
    as_several,
    as_size,
    real_array,
)
from duobench.world.robot.cameras import POLICY_CAMERAS

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
    cameras: tuple[str, ...] = POLICY_CAMERAS
    """Cameras that must be in the observation; the others are not rendered. All of the
    environment's by default; `()` for a policy that needs no images, which is faster."""
    object_state: bool = False
    """Whether the observation must hold `environment_state`, the privileged numbers of the
    objects."""
    image_size: tuple[int, int] | None = None
    """Height and width of every image in pixels, given as one number for a square; None takes the
    environment's default."""
    action_mode: str = "joint"
    """The environment's action mode that the actions are meant for."""
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
        for name, convert in _CONVERSIONS.items():
            try:
                object.__setattr__(self, name, convert(getattr(self, name)))
            except (TypeError, ValueError) as error:
                raise PolicyError(
                    f"The {name} of a policy cannot be {getattr(self, name)!r}: {error}."
                ) from error
        for name in ("name", "action_mode", "version", "dtype", "device"):
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
        if not all(isinstance(camera, str) for camera in self.cameras):
            raise PolicyError(
                f"The cameras of a policy are names, got {self.cameras!r}."
            )


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


_CONVERSIONS: Mapping[str, Callable[[Any], object]] = {
    "cameras": _names,
    "image_size": _or_none(
        as_size, "it is (height, width) in pixels, or one number for a square"
    ),
    "horizon": _or_none(as_count, "it is at least 1 action"),
    "object_state": bool,
    "batch_invariant": bool,
}
"""Conversions to plain values, which records and messages hold."""


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
                `pixels` with one HWC uint8 image per camera, and `environment_state` (n,) where
                the metadata ask for it.

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
        size = (
            "" if metadata.image_size is None else f", image_size={metadata.image_size}"
        )
        state = ", object_state=True" if metadata.object_state else ""
        raise PolicyError(
            f"Policy {metadata.name!r} does not fit the environment: {'; '.join(problems)}. One "
            f"that fits: duobench.make(task, cameras={metadata.cameras}{size}{state}, "
            f"action_mode={metadata.action_mode!r})."
        )


def _differences(metadata: PolicyMetadata, config: EnvConfig) -> Iterator[str]:
    for camera in metadata.cameras:
        if camera not in config.camera_names:
            cameras = ", ".join(config.camera_names) or "none"
            yield f"it sees camera {camera!r}, the environment shows {cameras}"
    size = metadata.image_size
    if metadata.cameras and size is not None and size != config.image_size:
        yield f"it sees images of {size}, the environment's are {config.image_size}"
    if metadata.object_state and not config.object_state:
        yield "it reads the state of the objects, which the environment does not show"
    if config.flat_obs:
        yield "it reads nested observations, the environment's are flat (flat_obs)"
    if metadata.action_mode != config.action_mode:
        yield f"its actions are {metadata.action_mode!r}, the environment's {config.action_mode!r}"
    if config.chunk is not None:
        yield "it gives chunks of any length, the environment takes chunks of one length"
