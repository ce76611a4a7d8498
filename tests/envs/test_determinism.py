"""Same seed, same episode: in any process, after any other episodes, seen by cameras or not."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
import pytest

import duobench
from tests.envs.tools import TASK, equal, hash_of_episode, sim_of, waves

SEED = 4
BLIND: dict[str, Any] = {"cameras": False}


@pytest.fixture(scope="module")
def expected() -> str:
    return hash_of_episode(BLIND, SEED)


def test_again(expected: str) -> None:
    assert hash_of_episode(BLIND, SEED) == expected
    assert hash_of_episode(BLIND, SEED + 1) != expected


def test_after_other_episodes(expected: str) -> None:
    assert hash_of_episode(BLIND, SEED, before=3) == expected


def test_with_cameras(expected: str) -> None:
    options = {"cameras": ("head",), "image_size": (24, 32)}
    assert hash_of_episode(options, SEED, before=1) == expected


def test_in_another_process(expected: str) -> None:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        assert pool.submit(hash_of_episode, BLIND, SEED, before=1).result() == expected


def test_a_restored_episode_continues_exactly() -> None:
    env = duobench.make(TASK, cameras=False)
    simulation = sim_of(env).simulation
    actions = waves(16)
    env.reset(seed=SEED)
    for action in actions[:6]:
        env.step(action)
    state = simulation.save()
    straight = [env.step(action)[0] for action in actions[6:]]
    end = simulation.state_hash()
    env.reset(seed=SEED + 1)
    for action in actions[:3]:
        env.step(action)
    simulation.restore(state)
    again = [env.step(action)[0] for action in actions[6:]]
    assert equal(again, straight)
    assert simulation.state_hash() == end
    assert np.array_equal(simulation.save(), simulation.save())
