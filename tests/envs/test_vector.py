"""Vector environments show the same episodes, images too, in this process and in others.

That whole episodes are the same is proven in `tests/test_determinism.py`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv

from duobench.tasks import catalog
from tests.envs.tools import TASK, equal, make_small, waves

Make = Callable[[], gym.Env]

COUNT, STEPS, SEED = 2, 5, 11
SEEING = {"cameras": ("head", "left_wrist"), "image_size": (24, 32)}


def single_episodes(make: Make) -> tuple[list[list[Any]], tuple[str, ...]]:
    """What a lone environment shows for each seed, and the hashes of the final states."""
    env = make()
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


def one_of(batch: Any, number: int) -> Any:
    """What a batch of observations holds for one environment."""
    if isinstance(batch, Mapping):
        return {key: one_of(values, number) for key, values in batch.items()}
    return batch[number]


def assert_same(vector: VectorEnv, make: Make) -> None:
    batches = played(vector)
    episodes, hashes = single_episodes(make)
    assert vector.call("state_hash") == hashes
    for number, episode in enumerate(episodes):
        for batch, alone in zip(batches, episode, strict=True):
            assert equal(one_of(batch[0], number), alone[0])
            for here, there in zip(batch[1:-1], alone[1:-1], strict=True):
                assert here[number] == there
            assert batch[-1]["stage"][number] == alone[-1]["stage"]
            assert np.array_equal(batch[-1]["clipped"][number], alone[-1]["clipped"])
    layouts = batches[0][1]["layout"]["poses"]
    for number, episode in enumerate(episodes):
        alone = episode[0][1]["layout"]["poses"]
        assert {name: layouts[name][number] for name in alone} == alone


@pytest.mark.parametrize("task", [TASK, "ball_maze"])
@pytest.mark.parametrize(
    "vectorize", [SyncVectorEnv, partial(AsyncVectorEnv, context="spawn")], ids=["sync", "spawn"]
)
def test_images_are_those_of_single_environments(
    task: str, vectorize: Callable[[list[Make]], VectorEnv]
) -> None:
    make = partial(make_small, task, **SEEING)
    vector = vectorize([make] * COUNT)
    images = vector.observation_space["pixels"]  # type: ignore[index]
    assert {space.shape for space in images.spaces.values()} == {(COUNT, 24, 32, 3)}
    assert_same(vector, make)
    vector.close()


@pytest.mark.parametrize("context", ["fork", "forkserver"])
def test_other_ways_to_start_processes(context: str) -> None:
    with warnings.catch_warnings():
        # Newer Pythons warn of forking a process with threads, which NumPy starts.
        warnings.filterwarnings("ignore", message=".*fork", category=DeprecationWarning)
        vector = AsyncVectorEnv([make_small] * COUNT, context=context)
    assert_same(vector, make_small)
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
