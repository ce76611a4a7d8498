"""Vector environments play the same episodes, bit for bit, in this process and in others."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv

from duobench.tasks import catalog
from tests.envs.tools import TASK, equal, make_small, waves

COUNT, STEPS, SEED = 2, 8, 11


def single_episodes() -> tuple[list[list[Any]], tuple[str, ...]]:
    """What a lone environment shows for each seed, and the hashes of the final states."""
    env = make_small()
    episodes, hashes = [], []
    for number in range(COUNT):
        told = [env.reset(seed=SEED + number)]
        told += [env.step(action) for action in waves(STEPS)]
        episodes.append(told)
        hashes.append(env.get_wrapper_attr("state_hash")())
    env.close()
    return episodes, tuple(hashes)


def played(vector: VectorEnv) -> list[Any]:
    told = [vector.reset(seed=SEED)]
    told += [vector.step(np.tile(action, (COUNT, 1))) for action in waves(STEPS)]
    return told


def assert_same(vector: VectorEnv) -> None:
    batches = played(vector)
    episodes, hashes = single_episodes()
    assert vector.call("state_hash") == hashes
    for number, episode in enumerate(episodes):
        for batch, alone in zip(batches, episode, strict=True):
            observations = {key: values[number] for key, values in batch[0].items()}
            assert equal(observations, alone[0])
            for here, there in zip(batch[1:-1], alone[1:-1], strict=True):
                assert here[number] == there
            assert batch[-1]["stage"][number] == alone[-1]["stage"]
            assert np.array_equal(batch[-1]["clipped"][number], alone[-1]["clipped"])
    layouts = batches[0][1]["layout"]["poses"]
    for number, episode in enumerate(episodes):
        alone = episode[0][1]["layout"]["poses"]
        assert {name: layouts[name][number] for name in alone} == alone


def test_sync() -> None:
    vector = SyncVectorEnv([make_small] * COUNT)
    assert_same(vector)
    vector.close()


@pytest.mark.parametrize("context", ["spawn", "fork", "forkserver"])
def test_async(context: str) -> None:
    with warnings.catch_warnings():
        # Newer Pythons warn of forking a process with threads, which NumPy starts.
        warnings.filterwarnings("ignore", message=".*fork", category=DeprecationWarning)
        vector = AsyncVectorEnv([make_small] * COUNT, context=context)
    assert_same(vector)
    assert vector.call("task") == (TASK,) * COUNT
    assert vector.call("task_description") == (catalog.get(TASK).instruction,) * COUNT
    assert vector.call("_max_episode_steps") == (catalog.get(TASK).horizon,) * COUNT
    vector.close()


def test_make_vec_takes_the_options() -> None:
    vector = gym.make_vec(
        f"duobench/{TASK}-v1", num_envs=COUNT, vectorization_mode="sync", cameras=False, chunk=2
    )
    assert vector.action_space.shape == (COUNT, 2, 16)
    vector.close()


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_episodes_follow_each_other_by_themselves(mode: AutoresetMode) -> None:
    vector = gym.make_vec(
        f"duobench/{TASK}-v1",
        num_envs=COUNT,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        cameras=False,
        horizon=3,
    )
    vector.reset(seed=SEED)
    ends = 0
    for action in waves(9):
        _, _, _, truncated, info = vector.step(np.tile(action, (COUNT, 1)))
        ends += int(truncated.all())
        assert set(info["is_success"].tolist()) == {False}
    assert ends == (3 if mode is AutoresetMode.SAME_STEP else 2)
    vector.close()
