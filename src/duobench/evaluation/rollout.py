"""The rollout loop: one policy, one environment, one episode, and whoever watches."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from duobench.envs.duo_env import base_of
from duobench.envs.sim_env import SPLIT
from duobench.policy.compatibility import check_fits
from duobench.policy.policy import Policy, as_chunk
from duobench.randomness import EVAL, policy_seed

Observation = Mapping[str, Any]
Info = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Step:
    """One control step, as watchers see it."""

    number: int
    """How many control steps the episode has had with this one, from 1."""
    action: NDArray[np.float32]
    """The action (n,) that was executed."""
    observation: Observation
    """What the environment showed afterwards; it has images only if somebody needs them."""
    reward: float
    """The reward of the step."""
    terminated: bool
    """Whether the environment ended the episode with this step."""
    truncated: bool
    """Whether the horizon ended the episode with this step."""
    info: Info
    """The environment's info."""


class Watcher(Protocol):
    """Something that watches episodes: a recorder, a video, a progress bar.

    With an attribute `needs_frames` that is true, images are rendered at every control step, not
    only at those that the policy sees.
    """

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:
        """The environment was reset, and the policy too."""
        ...

    def on_step(self, step: Step) -> None:
        """A control step was executed."""
        ...

    def on_episode_end(self, error: BaseException | None) -> None:
        """The episode is over; called exactly once, also if it never got to its start.

        Args:
            error: What made it crash, or None if it ended by itself.
        """
        ...


def rollout(
    env: gym.Env,
    policy: Policy,
    *,
    seed: int,
    watchers: Iterable[Watcher] = (),
    busy: Callable[[], AbstractContextManager[Any]] = nullcontext,
) -> None:
    """Run one episode.

    The actions of a chunk are executed in order, until the episode is over. Images are rendered
    only when somebody asks for them: the policy, which sees one observation a chunk, or a watcher
    that needs frames. At other steps the observation has no `pixels`, unless a wrapper around the
    environment is an `ObservationWrapper` or has an observation space of its own. A wrapper of any
    other kind that reads `pixels` must do without them where they are missing.

    A policy that disturbs its own actions may say in an attribute `intended_action` what it wanted
    its last action, a chunk of one, to be; that is what a recorder around the environment records.

    Args:
        env: An environment of the benchmark that takes single actions, in any wrappers.
        policy: The policy.
        seed: Seed of the reset. The policy gets a hash of it, `duobench.randomness.policy_seed`:
            an environment that is reset with that shows another layout.
        watchers: Called in this order.
        busy: Surrounds everything that the policy does, and the check of what it returned, which
            may wait for a lazy array.

    Raises:
        PolicyError: If the policy does not fit the environment, or returns something that is no
            chunk of actions.
    """
    check_fits(policy.metadata, env)
    watching = tuple(watchers)
    needs_frames = _changes_observations(env) or any(
        getattr(watcher, "needs_frames", False) for watcher in watching
    )
    render = _method(env, "set_rendering")
    intend = _method(env, "intend")
    (action_size,) = env.action_space.shape or (0,)
    with ExitStack() as ending:
        ending.callback(render, True)
        for watcher in reversed(watching):
            ending.push(partial(_end, watcher))
        observation, info = env.reset(seed=seed)
        hashed = policy_seed(base_of(env).task, seed, info.get(SPLIT) or EVAL)
        with busy():
            policy.reset(info["instruction"], hashed)
        for watcher in watching:
            watcher.on_episode_start(env, observation, info)
        number, over = 0, False
        while not over:
            with busy():
                chunk = as_chunk(policy.act(observation), action_size)
            for left, action in zip(reversed(range(len(chunk))), chunk, strict=True):
                render(needs_frames or left == 0)
                if (wanted := getattr(policy, "intended_action", None)) is not None:
                    intend(wanted)
                observation, reward, terminated, truncated, info = env.step(action)
                number += 1
                step = Step(
                    number=number,
                    action=action,
                    observation=observation,
                    reward=float(reward),
                    terminated=terminated,
                    truncated=truncated,
                    info=info,
                )
                for watcher in watching:
                    watcher.on_step(step)
                over = terminated or truncated
                if over:
                    break


def _method(env: gym.Env, name: str) -> Callable[..., None]:
    """A method of the wrapper that has it, wherever it is; nothing happens where none has."""
    try:
        return env.get_wrapper_attr(name)
    except AttributeError:
        return lambda *_arguments: None


def _changes_observations(env: gym.Env) -> bool:
    """Whether a wrapper around the one that renders makes something of every observation."""
    while isinstance(env, gym.Wrapper) and not hasattr(env, "set_rendering"):
        space = env.env.observation_space
        if isinstance(env, gym.ObservationWrapper) or env.observation_space is not space:
            return True
        env = env.env
    return False


def _end(watcher: Watcher, _kind: object, error: BaseException | None, _trace: object) -> None:
    watcher.on_episode_end(error)
