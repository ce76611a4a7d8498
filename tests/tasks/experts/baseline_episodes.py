"""Expert episodes of one environment alone: what every other way to run them is compared with."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import duobench
from duobench.envs.episode_state import EpisodeState
from duobench.envs.sim_env import sim_of
from duobench.evaluation.policies import ExpertPolicy


@dataclass(frozen=True, kw_only=True, slots=True)
class Episode:
    """What an expert did, and where it led."""

    actions: tuple[NDArray[np.float32], ...]
    """The actions (16,) up to the one that ended the episode."""
    results: tuple[tuple[Any, ...], ...]
    """What the reset (with reward 0 and no end), then every step gave back."""
    states: tuple[EpisodeState, ...]
    """The whole state before the first action and after each."""
    positions: tuple[NDArray[np.float64], ...]
    """Proprioception (16,), then the position (3,) of every object, along with each state."""

    @property
    def state_hash(self) -> str:
        """That of the state after the last action."""
        return self.states[-1].hash


SEEDS = (0, 1)
"""Seeds of the layouts whose episodes are played once and shared."""


def make(name: str) -> gym.Env:
    """An environment without cameras."""
    return duobench.make(name, cameras=False)


def play(
    env: gym.Env, expert: ExpertPolicy, seed: int, *, expert_seed: int | None = None
) -> Episode:
    """Play one episode to its end; the expert has the layout's seed if it is given none."""
    sim = sim_of(env).simulation
    actions: list[NDArray[np.float32]] = []
    results: list[tuple[Any, ...]] = []
    states: list[EpisodeState] = []
    positions: list[NDArray[np.float64]] = []

    def keep(result: tuple[Any, ...]) -> None:
        results.append(result)
        states.append(env.get_wrapper_attr("save_state")())
        positions.append(np.hstack([sim.duo.read().flat, *map(sim.position, sim.props)]))

    observation, info = env.reset(seed=seed)
    expert.reset(info["instruction"], seed if expert_seed is None else expert_seed)
    keep((observation, 0.0, False, False, info))
    while not (results[-1][2] or results[-1][3]):
        actions.append(np.asarray(expert.act(results[-1][0]), dtype=np.float32)[0])
        keep(env.step(actions[-1]))
    return Episode(
        actions=tuple(actions),
        results=tuple(results),
        states=tuple(states),
        positions=tuple(positions),
    )


def play_alone(name: str, *seeds: int) -> tuple[Episode, ...]:
    """Play episodes one after another in a new environment by a new expert."""
    env = make(name)
    expert = ExpertPolicy(env)
    episodes = tuple(play(env, expert, seed) for seed in seeds)
    env.close()
    return episodes


@cache
def baseline(name: str) -> tuple[Episode, ...]:
    """Episodes of the shared seeds, in their order; the last one is played first.

    They are played once in a session: what a golden file holds was played in the other order.
    """
    return play_alone(name, *reversed(SEEDS))[::-1]
