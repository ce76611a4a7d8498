"""Gymnasium: its checker, wrappers, vector environments and specs."""

import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import wrappers
from gymnasium.envs.registration import EnvSpec

from tests.children import ran
from tests.ecosystem.tools import HORIZON, IMAGES, RENDERED, flat, nested, states
from tests.envs.tools import TASK, check

MADE: Mapping[str, Callable[..., gym.Env]] = {"flat": flat, "nested": nested, "states": states}
OPTIONS = [
    {},
    RENDERED,
    {"chunk": 2},
    {"action_mode": "cartesian_relative", "binary_gripper": True},
    {"shift": "sensing-5", "look": "random:2"},
]


@pytest.mark.parametrize("options", OPTIONS, ids=str)
@pytest.mark.parametrize("made", MADE)
def test_the_checker_has_nothing_to_say(made: str, options: dict[str, Any]) -> None:
    check(MADE[made](**options))


class WithoutStages(gym.Wrapper):
    """Without the one entry of `info` whose keys are numbers, which some converters cannot take."""

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        observation, info = super().reset(**options)
        return observation, without_stages(info)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        *transition, info = super().step(action)
        return *transition, without_stages(info)


def without_stages(info: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in info.items() if key != "stage_to_subinstructions"}


WRAPPED: Mapping[str, Callable[[], gym.Env]] = {
    "AddRenderObservation": lambda: wrappers.AddRenderObservation(
        flat(**RENDERED), render_only=False
    ),
    "Autoreset": lambda: wrappers.Autoreset(flat()),
    "ClipAction": lambda: wrappers.ClipAction(flat()),
    "DelayObservation": lambda: wrappers.DelayObservation(flat(), 1),
    "DiscretizeAction": lambda: wrappers.DiscretizeAction(flat(), 3),
    "FilterObservation": lambda: wrappers.FilterObservation(flat(), ["agent_pos", "head_image"]),
    "FlattenObservation": lambda: wrappers.FlattenObservation(states()),
    "FrameStackObservation": lambda: wrappers.FrameStackObservation(flat(), 3),
    "FrameStackObservation, nested": lambda: wrappers.FrameStackObservation(nested(), 3),
    "NormalizeObservation": lambda: wrappers.NormalizeObservation(
        wrappers.FlattenObservation(states())
    ),
    "NormalizeReward": lambda: wrappers.NormalizeReward(flat()),
    "NumpyToTorch": lambda: wrappers.NumpyToTorch(WithoutStages(nested())),
    "OrderEnforcing": lambda: wrappers.OrderEnforcing(flat()),
    "PassiveEnvChecker": lambda: wrappers.PassiveEnvChecker(flat()),
    "RecordEpisodeStatistics": lambda: wrappers.RecordEpisodeStatistics(flat()),
    "RescaleAction": lambda: wrappers.RescaleAction(flat(), np.float32(-1), np.float32(1)),
    "StickyAction": lambda: wrappers.StickyAction(flat(), 0.5),
    "TimeAwareObservation": lambda: wrappers.TimeAwareObservation(flat(), flatten=False),
    "TransformReward": lambda: wrappers.TransformReward(flat(), lambda reward: 2 * reward),
}


@pytest.mark.parametrize("name", WRAPPED)
def test_an_episode_runs_to_its_end_in_a_wrapper(name: str) -> None:
    env = WRAPPED[name]()
    torches = name == "NumpyToTorch"
    observation, _ = env.reset(seed=0)
    for number in range(1, HORIZON + 1):
        assert torches or observation in env.observation_space
        action = env.action_space.sample()
        observation, _, terminated, truncated, info = env.step(
            torch.as_tensor(action) if torches else action
        )
        assert not terminated
        assert truncated == (number == HORIZON)
    assert env.get_wrapper_attr("task") == TASK
    assert name != "RecordEpisodeStatistics" or info["episode"]["l"] == HORIZON
    env.close()


def test_a_converter_of_arrays_takes_no_numbers_as_keys_of_info() -> None:
    with pytest.raises(TypeError, match="keywords must be strings"):
        wrappers.NumpyToTorch(nested()).reset(seed=0)


def test_an_episode_is_recorded_as_a_video(tmp_path: Path) -> None:
    env = wrappers.RecordVideo(flat(**RENDERED), str(tmp_path / "videos"))
    env.reset(seed=0)
    while not env.step(env.action_space.sample())[3]:
        pass
    env.close()
    (video,) = (tmp_path / "videos").glob("*.mp4")
    assert video.stat().st_size > 1000


@pytest.mark.parametrize("made", MADE)
@pytest.mark.parametrize("wrap", [lambda env: env, wrappers.RecordEpisodeStatistics])
def test_a_spec_goes_through_its_text(made: str, wrap: Callable[[gym.Env], gym.Env]) -> None:
    env = wrap(MADE[made]())
    assert env.spec is not None
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert str(again) == str(env)
    assert again.observation_space == env.observation_space
    assert again.get_wrapper_attr("config") == env.get_wrapper_attr("config")


# In a process of its own, as a program that has not rendered before.
VECTOR = """
import warnings
import gymnasium as gym
import numpy as np
import duobench

warnings.filterwarnings("ignore", message=".*fork", category=DeprecationWarning)
envs = gym.make_vec({id!r}, num_envs=2, vectorization_mode={mode!r}, vector_kwargs={kwargs!r},
    **{options!r})
observation, _ = envs.reset(seed=3)
for _ in range(2):
    observation, *_ = envs.step(np.tile(envs.call("hold_action")[0], (2, 1)))
assert observation["head_image"].shape == (2, 48, 64, 3)
print(*envs.call("state_hash"))
envs.close()
"""
MODES = {
    "sync": ("sync", {}),
    "async": ("async", {}),
    "spawn": ("async", {"context": "spawn"}),
    "forkserver": ("async", {"context": "forkserver"}),
    "no shared memory": ("async", {"context": "spawn", "shared_memory": False}),
}


@pytest.fixture(scope="module")
def alone() -> list[str]:
    """What single environments end at."""
    hashes = []
    for seed in (3, 4):
        env = flat()
        env.reset(seed=seed)
        for _ in range(2):
            env.step(env.get_wrapper_attr("hold_action")())
        hashes.append(env.get_wrapper_attr("state_hash")())
        env.close()
    return hashes


@pytest.mark.parametrize("name", MODES)
def test_vector_environments_play_what_single_ones_play(name: str, alone: list[str]) -> None:
    mode, kwargs = MODES[name]
    options = {**IMAGES, "flat_obs": True}
    code = VECTOR.format(id=f"duobench/{TASK}-v1", mode=mode, kwargs=kwargs, options=options)
    done = ran("-c", textwrap.dedent(code))
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == alone


def test_a_fork_of_a_process_that_has_rendered_plays_the_same(alone: list[str]) -> None:
    options = {**IMAGES, "flat_obs": True}
    mode = {"mode": "async", "kwargs": {"context": "fork"}}
    image = f"import duobench; duobench.make({TASK!r}, **{IMAGES!r}).reset(seed=0)\n"
    done = ran("-c", image + VECTOR.format(id=f"duobench/{TASK}-v1", **mode, options=options))
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == alone
