"""Whether a policy and an environment fit together, checked before the first step."""

from __future__ import annotations

from collections.abc import Iterator

import gymnasium as gym

from duobench.envs.wrappers import (
    ActionChunks,
    CartesianActions,
    RelativeCartesianActions,
    RelativeJointActions,
)
from duobench.envs.wrappers.cameras import PIXELS
from duobench.errors import PolicyError
from duobench.policy.protocol import PolicyMetadata

_MODES: tuple[tuple[type[gym.Wrapper], str], ...] = (
    (RelativeCartesianActions, "cartesian_relative"),
    (CartesianActions, "cartesian"),
    (RelativeJointActions, "joint_relative"),
)
_DEFAULT_MODE = "joint"


def check_fits(metadata: PolicyMetadata, env: gym.Env) -> None:
    """Refuse a policy that expects another environment.

    Args:
        metadata: What the policy expects.
        env: The environment that it would act in.

    Raises:
        PolicyError: If anything differs; the message lists all of it, and how to make an
            environment that fits.
    """
    problems = [*_picture_problems(metadata, env), *_action_problems(metadata, env)]
    if problems:
        size = "" if metadata.image_size is None else f", image_size={metadata.image_size}"
        raise PolicyError(
            f"Policy {metadata.name!r} does not fit the environment: {'; '.join(problems)}. One "
            f"that fits: duobench.make(task, cameras={metadata.cameras}{size}, "
            f"action_mode={metadata.action_mode!r})."
        )


def _picture_problems(metadata: PolicyMetadata, env: gym.Env) -> Iterator[str]:
    """What is wrong with the pictures."""
    space = env.observation_space
    pixels = space.spaces.get(PIXELS) if isinstance(space, gym.spaces.Dict) else None
    shown = dict(pixels.spaces) if isinstance(pixels, gym.spaces.Dict) else {}
    for camera in metadata.cameras:
        if camera not in shown:
            yield f"it sees camera {camera!r}, the environment shows {', '.join(shown) or 'none'}"
            continue
        size = (shown[camera].shape or ())[:2]
        if metadata.image_size is not None and size != tuple(metadata.image_size):
            yield f"it sees pictures of {metadata.image_size}, {camera!r} has {size}"


def _action_problems(metadata: PolicyMetadata, env: gym.Env) -> Iterator[str]:
    """What is wrong with the actions."""
    layers = list(_layers(env))
    if any(isinstance(layer, ActionChunks) for layer in layers):
        yield "it is asked for chunks of any length, the environment takes chunks of one length"
    modes = (name for layer in layers for kind, name in _MODES if isinstance(layer, kind))
    mode = next(modes, _DEFAULT_MODE)
    if mode != metadata.action_mode:
        yield f"its actions are {metadata.action_mode!r}, the environment's {mode!r}"
    rate = layers[-1].metadata.get("render_fps")
    if rate != metadata.control_rate_hz:
        yield f"it acts {metadata.control_rate_hz:g} times a second, the environment {rate}"


def _layers(env: gym.Env) -> Iterator[gym.Env]:
    """The wrappers of an environment from the outside in, then the environment itself."""
    yield env
    while isinstance(env, gym.Wrapper):
        env = env.env
        yield env
