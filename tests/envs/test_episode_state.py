"""A saved state is the whole state: what comes after it is the same to the last bit.

Whole episodes of experts are in `tests.tasks.experts.test_episodes`.
"""

from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from duobench.core.errors import LayoutError, SimulationError
from duobench.envs import CartesianActions, RelativeCartesianActions, TimeLimit
from duobench.envs.episode_state import StateError
from duobench.envs.sim_env import SimEnv
from duobench.tasks import catalog
from tests.envs.tools import TASK, Make, equal, waves


@pytest.mark.parametrize("mode", ["joint_relative", "cartesian", "cartesian_relative"])
def test_every_action_mode_goes_on_as_it_did(make: Make, mode: str) -> None:
    env = make(action_mode=mode, binary_gripper=True)
    rng = np.random.default_rng(1)
    low, high = env.action_space.low, env.action_space.high
    actions = [0.3 * rng.uniform(low, high).astype(np.float32) for _ in range(12)]
    env.reset(seed=0)
    for action in actions[:6]:
        env.step(action)
    state = env.save_state()
    straight = [env.step(action) for action in actions[6:]], env.state_hash()
    env.reset(seed=3)
    env.step(actions[0])
    env.restore_state(state)
    assert equal(([env.step(action) for action in actions[6:]], env.state_hash()), straight)


def test_a_restored_episode_shows_what_it_did_and_ends_when_it_would_have(make: Make) -> None:
    env = make(cameras=("head",), image_size=(24, 32), horizon=5)
    env.reset(seed=0)
    seen = [env.step(action)[0] for action in waves(3)]
    state = env.save_state()
    env.reset(seed=1)
    observation, _ = env.restore_state(state)
    assert equal(observation, seen[-1]), "images, too"
    assert [env.step(action)[3] for action in waves(2)] == [False, True]
    assert env.save_state().over
    with pytest.raises(gym.error.ResetNeeded):
        env.step(waves(1)[0])


def test_layouts_that_differ_in_a_variant_differ_in_their_hash() -> None:
    env = SimEnv(catalog.get("ball_maze"))
    _, info = env.reset(seed=0)
    hashes = []
    for board in ("0", "1", "0"):
        env.reset(options={"layout": {**info["layout"], "variants": {"board": board}}})
        hashes.append(env.state_hash())
    assert hashes[0] == hashes[2] != hashes[1]


def test_stage_and_steps_are_part_of_the_hash(make: Make) -> None:
    env = make()
    env.reset(seed=0)
    state = env.save_state()
    other = replace(state, progress=replace(state.progress, stage=1))
    assert len({state.hash, other.hash, replace(state, steps=1).hash}) == 3


def test_a_state_of_another_task_or_stack_is_refused(make: Make) -> None:
    env, bare, other = make(), SimEnv(catalog.get(TASK)), SimEnv(catalog.get("transfer_cube"))
    for one in (env, bare, other):
        one.reset(seed=0)
    state = bare.save_state()
    relative = RelativeCartesianActions(CartesianActions(bare))
    for one, saved, error, words in (
        (env, state, StateError, "time limit"),
        (relative, state, StateError, "relative Cartesian"),
        (env, replace(TimeLimit(bare, 5).save_state(), steps=1), StateError, "stages"),
        (bare, other.save_state(), LayoutError, "layout must place exactly"),
        (bare, replace(state, physics=np.zeros(3)), SimulationError, "another task or version"),
    ):
        with pytest.raises(error, match=words):
            one.restore_state(saved)


@pytest.mark.parametrize("wrong", [b"state", {}, None, 3])
def test_what_is_no_state_is_refused(make: Make, wrong: Any) -> None:
    env = make()
    env.reset(seed=0)
    with pytest.raises(StateError, match=r"comes from env\.save_state\(\), got "):
        env.restore_state(wrong)
