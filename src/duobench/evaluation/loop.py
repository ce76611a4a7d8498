"""The rollout loop: one policy, one environment, one episode; whoever watches subscribes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from duobench.envs.wrappers.cameras import Cameras
from duobench.policy.compatibility import check_fits
from duobench.policy.protocol import Policy, as_chunk

Observation = Mapping[str, Any]
Info = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Step:
    """One control step, as subscribers see it."""

    number: int
    """How many control steps the episode has had with this one, from 1."""
    action: NDArray[np.float32]
    """The action that was executed."""
    observation: Observation
    """What the environment showed afterwards; with pictures only if the policy sees it next."""
    terminated: bool
    """Whether the environment ended the episode with this step."""
    truncated: bool
    """Whether the horizon ended the episode with this step."""
    info: Info
    """What else the environment told."""


class Subscriber(Protocol):
    """Something that watches episodes: a recorder, a camera, a progress bar."""

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:
        """The environment was reset and the policy told to begin."""
        ...

    def on_step(self, step: Step) -> None:
        """A control step was executed."""
        ...

    def on_episode_end(self) -> None:
        """The episode is over; not called for one that broke off."""
        ...


def rollout(
    env: gym.Env, policy: Policy, *, seed: int, subscribers: Iterable[Subscriber] = ()
) -> None:
    """Run one episode.

    The actions of a chunk are executed in order, until the episode is over. Pictures are drawn only
    when the policy is about to see them, which is once a chunk.

    Args:
        env: An environment of the benchmark that takes single actions.
        policy: The policy.
        seed: Seed of the reset and of the policy.
        subscribers: Who is told, in this order.

    Raises:
        PolicyError: If the policy does not fit the environment, or returns something that is no
            chunk of actions.
    """
    check_fits(policy.metadata, env)
    watching = tuple(subscribers)
    blind = env.env if isinstance(env, Cameras) else env
    (width,) = env.action_space.shape or (0,)
    observation, info = env.reset(seed=seed)
    policy.reset(info["instruction"], seed)
    for subscriber in watching:
        subscriber.on_episode_start(env, observation, info)
    number, over = 0, False
    while not over:
        chunk = as_chunk(policy.act(observation), width)
        last = len(chunk) - 1
        for index, action in enumerate(chunk):
            stepped = env if index == last else blind
            observation, _, terminated, truncated, info = stepped.step(action)
            number += 1
            over = terminated or truncated
            step = Step(
                number=number,
                action=action,
                observation=observation,
                terminated=terminated,
                truncated=truncated,
                info=info,
            )
            for subscriber in watching:
                subscriber.on_step(step)
            if over:
                break
    for subscriber in watching:
        subscriber.on_episode_end()
