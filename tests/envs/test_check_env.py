"""Gymnasium's own checker, with warnings as errors, over the options."""

import warnings
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from duobench import Camera
from tests.envs.tools import TASK, Make, check, sim_of

SIDE = Camera(name="side", position=(0.5, 1.2, 0.6), look_at=(0.5, 0.0, 0.0), size=(20, 30))
SMALL: Mapping[str, Any] = {"image_size": (24, 32), "render_size": (24, 32), "cameras": False}


@pytest.mark.long
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"action_mode": "joint_relative"},
        {"action_mode": "cartesian"},
        {"action_mode": "cartesian_relative"},
        {"binary_gripper": True},
        {"action_mode": "cartesian_relative", "binary_gripper": True, "chunk": 3},
        {"chunk": 1},
        {"horizon": 10},
        {"cameras": True},
        {"object_state": True},
        {"cameras": True, "object_state": True, "flat_obs": True},
        {"cameras": ("left_wrist",), "chunk": 4},
        {"cameras": True, "depth": True, "segmentation": True},
        {"cameras": ("head", SIDE), "depth": "side", "segmentation": True, "flat_obs": True},
        {"depth": "head", "shift": "sensing-2"},
        {"cameras": ("head",), "action_mode": "cartesian", "render_mode": "rgb_array"},
    ],
    ids=str,
)
def test_every_option_passes(options: dict[str, Any]) -> None:
    check(gym.make(f"duobench/{TASK}-v1", **{**SMALL, **options}))


def test_the_base_environment_passes() -> None:
    check(gym.make(f"duobench/{TASK}-v1", **SMALL).unwrapped)


def test_the_passive_checker_has_nothing_to_say(make: Make) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = make(disable_env_checker=False)
        env.reset(seed=0)
        for _ in range(3):
            env.step(env.action_space.sample())


def test_a_normalized_action_space_is_one_wrapper_away(make: Make) -> None:
    env = gym.wrappers.RescaleAction(make(), np.float32(-1.0), np.float32(1.0))
    observation, _ = env.reset(seed=0)
    joints = sim_of(env).action_space
    stay = (observation["agent_pos"] - joints.low) / (joints.high - joints.low)
    assert not env.step(2 * stay - 1)[4]["clipped"].any()
    sent = sim_of(env).simulation.duo.command().flat
    assert sent == pytest.approx(observation["agent_pos"], abs=1e-3)
