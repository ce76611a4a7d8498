"""Vector environments show the same episodes, images too, in this process and in others.

That whole episodes are the same is proven in `tests/test_determinism.py`.
"""

import warnings
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv

from duobench import Camera
from duobench.tasks import catalog
from tests.envs.tools import TASK, equal, make_small, waves

Make = Callable[[], gym.Env]

COUNT, STEPS, SEED = 2, 5, 11
SIDE = Camera(name="side", position=(0.5, 1.2, 0.6), look_at=(0.5, 0.0, 0.0), size=(20, 20))
SEEING = {
    "cameras": ("head", "left_wrist", SIDE),
    "image_size": (24, 32),
    "object_state": True,
    "depth": ("side", "head"),
    "segmentation": "left_wrist",
}


def one_of(batch: Any, number: int) -> Any:
    """What a batch of observations holds for one environment."""
    if isinstance(batch, Mapping):
        return {key: one_of(values, number) for key, values in batch.items()}
    return batch[number]


@pytest.mark.long
@pytest.mark.parametrize("context", [None, "spawn", "fork", "forkserver"])
def test_observations_and_info_are_those_of_single_environments(context: str | None) -> None:
    make = partial(make_small, "ball_maze", **({} if context == "fork" else SEEING))
    with warnings.catch_warnings():
        # Newer Pythons warn of forking a process with threads, which NumPy starts.
        warnings.filterwarnings("ignore", message=".*fork", category=DeprecationWarning)
        made = [make] * COUNT
        vector = AsyncVectorEnv(made, context=context) if context else SyncVectorEnv(made)
    batches = [vector.reset(seed=SEED)]
    batches += [vector.step(np.tile(action, (COUNT, 1))) for action in waves(STEPS)]
    assert vector.call("task_description") == (catalog.get("ball_maze").instruction,) * COUNT
    for number in range(COUNT):
        env = make()
        episode = [env.reset(seed=SEED + number), *map(env.step, waves(STEPS))]
        assert vector.call("state_hash")[number] == env.get_wrapper_attr("state_hash")()
        for batch, alone in zip(batches, episode, strict=True):
            assert equal(one_of(batch[0], number), alone[0])
            assert [values[number] for values in batch[1:-1]] == list(alone[1:-1])
            for key in ("stage", "clipped"):
                assert np.array_equal(batch[-1][key][number], alone[-1][key])
        places = vector.call("cameras")[number]
        assert places.keys() == env.get_wrapper_attr("cameras").keys()
        for name, place in env.get_wrapper_attr("cameras").items():
            assert np.array_equal(places[name].table_from_camera, place.table_from_camera)
        here, alone = (info["layout"]["poses"] for info in (batches[0][1], episode[0][1]))
        assert {name: here[name][number] for name in alone} == alone
        env.close()
    vector.close()


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_episodes_follow_each_other_by_themselves(mode: AutoresetMode) -> None:
    options = {"cameras": False, "chunk": 1, "horizon": 3}
    options["vector_kwargs"] = {"autoreset_mode": mode}
    vector = gym.make_vec(f"duobench/{TASK}-v1", COUNT, "sync", **options)
    assert vector.action_space.shape == (COUNT, 1, 16)
    vector.reset(seed=SEED)
    ends = 0
    for action in waves(9):
        _, _, _, truncated, info = vector.step(np.tile(action, (COUNT, 1, 1)))
        ends += int(truncated.all())
        assert not info["is_success"].any()
    assert ends == (3 if mode is AutoresetMode.SAME_STEP else 2)
    vector.close()
