"""Expert episodes of one environment alone: what every other way to run them is compared with."""

from __future__ import annotations

from dataclasses import dataclass

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import duobench
from duobench.evaluation.policies import ExpertPolicy


@dataclass(frozen=True, kw_only=True, slots=True)
class Episode:
    """What an expert did, and where it led."""

    actions: tuple[NDArray[np.float32], ...]
    """The actions (16,) up to the one that ended the episode."""
    state_hash: str
    """That of the state after the last action."""


def make(name: str) -> gym.Env:
    """An environment without cameras."""
    return duobench.make(name, cameras=False)


def play(
    env: gym.Env, expert: ExpertPolicy, seed: int, *, expert_seed: int | None = None
) -> Episode:
    """Play one episode to its end; the expert has the layout's seed if it is given none."""
    observation, info = env.reset(seed=seed)
    expert.reset(info["instruction"], seed if expert_seed is None else expert_seed)
    actions: list[NDArray[np.float32]] = []
    over = False
    while not over:
        actions.append(np.asarray(expert.act(observation), dtype=np.float32)[0])
        observation, _, terminated, truncated, _ = env.step(actions[-1])
        over = terminated or truncated
    return Episode(actions=tuple(actions), state_hash=env.get_wrapper_attr("state_hash")())


def play_alone(name: str, seed: int) -> Episode:
    """Play one episode, the first of a new environment and of a new expert."""
    env = make(name)
    episode = play(env, ExpertPolicy(env), seed)
    env.close()
    return episode
