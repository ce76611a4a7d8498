"""A saved state is the whole state: what comes after it is the same to the last bit.

Whole episodes of experts are in `tests.experts.test_episodes`.
"""

from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench.envs import CartesianActions, RelativeCartesianActions, TimeLimit
from duobench.envs.episode_state import EpisodeState, StateError
from duobench.envs.sim_env import SimEnv
from duobench.errors import SimulationError
from duobench.tasks import catalog
from tests.envs.tools import TASK, equal, waves


def hash_of(env: gym.Env) -> str:
    return env.get_wrapper_attr("state_hash")()


def save(env: gym.Env) -> EpisodeState:
    return env.get_wrapper_attr("save_state")()


def restore(env: gym.Env, state: EpisodeState) -> tuple[Any, Any]:
    return env.get_wrapper_attr("restore_state")(state)


@pytest.mark.parametrize("mode", ["joint_relative", "cartesian", "cartesian_relative"])
def test_every_action_mode_goes_on_as_it_did(mode: str) -> None:
    env = duobench.make(TASK, cameras=False, action_mode=mode, binary_gripper=True)
    rng = np.random.default_rng(1)
    low, high = env.action_space.low, env.action_space.high  # type: ignore[attr-defined]
    actions = [0.3 * rng.uniform(low, high).astype(np.float32) for _ in range(12)]
    env.reset(seed=0)
    for action in actions[:6]:
        env.step(action)
    state = save(env)
    straight = [env.step(action) for action in actions[6:]]
    end = hash_of(env)
    env.reset(seed=3)
    env.step(actions[0])
    restore(env, state)
    assert equal([env.step(action) for action in actions[6:]], straight)
    assert hash_of(env) == end
    env.close()


def test_a_restored_episode_shows_what_it_did_and_ends_when_it_would_have() -> None:
    env = duobench.make(TASK, cameras=("head",), image_size=(24, 32), horizon=5)
    env.reset(seed=0)
    seen = [env.step(action)[0] for action in waves(3)]
    state = save(env)
    env.reset(seed=1)
    observation, _ = restore(env, state)
    assert equal(observation, seen[-1]), "images, too"
    assert [env.step(action)[3] for action in waves(2)] == [False, True]
    assert save(env).over
    with pytest.raises(gym.error.ResetNeeded):
        env.step(waves(1)[0])
    env.close()


def test_layouts_that_differ_in_a_variant_differ_in_their_hash() -> None:
    env = SimEnv(catalog.get("ball_maze"))
    _, info = env.reset(seed=0)
    hashes = set()
    for board in ("0", "1", "0"):
        env.reset(options={"layout": {**info["layout"], "variants": {"board": board}}})
        hashes.add(env.state_hash())
    assert len(hashes) == 2
    env.close()


def test_stage_and_steps_are_part_of_the_hash() -> None:
    env = duobench.make(TASK, cameras=False)
    env.reset(seed=0)
    state = save(env)
    assert state.progress is not None
    other = replace(state, progress=replace(state.progress, stage=1))
    assert len({state.hash, other.hash, replace(state, steps=1).hash}) == 3
    env.close()


def test_a_state_of_another_task_or_stack_is_refused() -> None:
    env, bare = duobench.make(TASK, cameras=False), SimEnv(catalog.get(TASK))
    env.reset(seed=0)
    bare.reset(seed=0)
    with pytest.raises(StateError, match="time limit"):
        restore(env, bare.save_state())
    with pytest.raises(StateError, match="relative Cartesian"):
        restore(RelativeCartesianActions(CartesianActions(bare)), bare.save_state())
    with pytest.raises(StateError, match="stages"):
        restore(env, replace(save(TimeLimit(bare, 5)), steps=1))
    other = SimEnv(catalog.get("transfer_cube"))
    other.reset(seed=0)
    with pytest.raises(Exception, match="layout must place exactly") as refusal:
        restore(bare, other.save_state())
    assert type(refusal.value).__module__ == "duobench.errors"
    short = replace(bare.save_state(), physics=np.zeros(3))
    with pytest.raises(SimulationError, match="another task or version"):
        restore(bare, short)
    for one in (env, bare, other):
        one.close()
