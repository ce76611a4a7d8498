"""Gymnasium's own checker, with warnings as errors, over the options."""

import warnings
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import duobench
from tests.envs.tools import TASK, check, sim_of

SMALL: Mapping[str, Any] = {"image_size": (24, 32), "render_size": (24, 32)}


@pytest.mark.parametrize(
    "options",
    [
        {"cameras": False},
        {"cameras": False, "action_mode": "joint_relative"},
        {"cameras": False, "action_mode": "cartesian"},
        {"cameras": False, "action_mode": "cartesian_relative"},
        {"cameras": False, "binary_gripper": True},
        {"cameras": False, "action_mode": "cartesian_relative", "binary_gripper": True, "chunk": 3},
        {"cameras": False, "chunk": 1},
        {"cameras": False, "horizon": 10},
        {"cameras": True},
        {"cameras": False, "object_state": True},
        {"cameras": ("left_wrist",), "chunk": 4},
        {"cameras": ("head",), "action_mode": "cartesian", "render_mode": "rgb_array"},
    ],
    ids=str,
)
def test_every_option_passes(options: dict[str, Any]) -> None:
    check(gym.make(f"duobench/{TASK}-v1", **SMALL, **options))


def test_the_base_environment_passes() -> None:
    check(gym.make(f"duobench/{TASK}-v1", cameras=False, **SMALL).unwrapped)


def test_the_passive_checker_has_nothing_to_say() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make(f"duobench/{TASK}-v1", cameras=False, disable_env_checker=False)
        env.reset(seed=0)
        for _ in range(3):
            env.step(env.action_space.sample())
    env.close()


def test_a_normalized_action_space_is_one_wrapper_away() -> None:
    env = gym.wrappers.RescaleAction(
        duobench.make(TASK, cameras=False), np.float32(-1.0), np.float32(1.0)
    )
    observation, _ = env.reset(seed=0)
    joints = sim_of(env).action_space
    stay = (observation["agent_pos"] - joints.low) / (joints.high - joints.low)
    _, _, _, _, info = env.step(2 * stay - 1)
    assert not info["clipped"].any()
    assert sim_of(env).simulation.duo.command().flat == pytest.approx(
        observation["agent_pos"], abs=1e-3
    )
    env.close()
