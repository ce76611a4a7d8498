"""Observations of one level hold what the nested ones hold, in whatever the environment is put."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from duobench.core.errors import PolicyError
from duobench.envs import FlatObservations, sim_of
from duobench.evaluation import rollout
from duobench.policy import HoldPolicy
from tests.envs.tools import TASK, Make, equal, waves

SMALL = {"cameras": ("head", "left_wrist"), "image_size": (24, 32)}
KEYS = {"agent_pos", "tcp_pose", "head_image", "left_wrist_image"}


def flat(observation: dict[str, Any]) -> dict[str, Any]:
    """What a nested observation is in one level, made in another way."""
    images = {f"{name}_image": image for name, image in observation["pixels"].items()}
    return {**{key: observation[key] for key in observation.keys() - {"pixels"}}, **images}


@pytest.mark.parametrize(
    "options", [{}, {"object_state": True}, {"chunk": 2}, {"shift": "sensing-5"}], ids=str
)
def test_it_holds_the_same_in_one_level(make: Make, options: dict[str, Any]) -> None:
    env, nested = (make(**SMALL, **options, flat_obs=is_flat) for is_flat in (True, False))
    assert set(env.observation_space) - {"environment_state"} == KEYS
    starts = env.reset(seed=4)[0], nested.reset(seed=4)[0]
    action = waves(2) if "chunk" in options else waves(1)[0]
    steps = env.step(action)[0], nested.step(action)[0]
    for one, other in (starts, steps):
        assert one in env.observation_space
        assert equal(dict(sorted(one.items())), dict(sorted(flat(other).items())))
    state = env.save_state()
    env.step(action)
    restored, _ = env.restore_state(state)
    if "shift" not in options:  # noise is another one after a state was restored
        assert equal(restored, steps[0])
    env.get_wrapper_attr("set_rendering")(False)
    assert not {key for key in env.step(action)[0] if key.endswith("_image")}


def test_it_is_kept_by_specs_vectors_and_wrappers(make: Make) -> None:
    env = make(**SMALL, flat_obs=True, render_mode="rgb_array", horizon=3)
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.observation_space == env.observation_space
    assert sim_of(again).config == sim_of(env).config
    recorded = gym.wrappers.TransformObservation(env, lambda seen: seen, env.observation_space)
    assert equal(recorded.reset(seed=2)[0], again.reset(seed=2)[0])
    again.close()
    vector = gym.make_vec(f"duobench/{TASK}-v1", 2, "sync", **SMALL, flat_obs=True)
    batch, _ = vector.reset(seed=2)
    assert batch["head_image"].shape == (2, 24, 32, 3)
    assert np.array_equal(batch["head_image"][0], env.reset(seed=2)[0]["head_image"])
    vector.close()


def test_without_cameras_nothing_changes(make: Make) -> None:
    env = FlatObservations(make())
    assert env.observation_space == env.env.observation_space


def test_a_policy_of_the_benchmark_takes_nested_ones(make: Make) -> None:
    with pytest.raises(PolicyError, match=r"reads nested observations.*flat_obs.*One that fits"):
        rollout(make(**SMALL, flat_obs=True), HoldPolicy(), seed=0)
