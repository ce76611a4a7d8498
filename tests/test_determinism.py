"""An episode is a function of task and seed, bit for bit: not of cameras or of vector environments.

`tests.tasks.experts.test_episodes` adds the process and what ran before: golden episodes were
played by another one, in another order. The number of workers is in
`tests.evaluation.test_evaluate` and, for experts, in
`tests.evaluation.runners.test_demonstrations`. Other tests rely on these.
"""

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench.envs.registration import env_id
from duobench.world.robot.frames import ROBOT
from tests.tasks.experts.baseline_episodes import SEEDS, baseline

SEED, _ = SEEDS
VECTOR_TASKS = ("bin_sort", "ball_maze")
"""The shortest task, and one whose layouts have a variant."""


@pytest.mark.slow
def test_cameras_change_nothing() -> None:
    name = VECTOR_TASKS[0]
    (episode, _) = baseline(name)
    env = duobench.make(name, cameras=("head",), image_size=(24, 32))
    env.reset(seed=SEED)
    for action in episode.actions:
        env.step(action)
    assert env.get_wrapper_attr("state_hash")() == episode.state_hash
    env.close()


@pytest.mark.long
@pytest.mark.parametrize("name", VECTOR_TASKS)
@pytest.mark.parametrize("vector", [gym.vector.SyncVectorEnv, gym.vector.AsyncVectorEnv])
def test_vector_environments_play_the_same_episodes(
    name: str, vector: type[gym.vector.VectorEnv]
) -> None:
    """Each environment gets its own episode's actions; who is done first goes on with another."""
    episodes = baseline(name)
    envs = vector([lambda: gym.make(env_id(name), cameras=False)] * len(episodes))
    envs.reset(seed=list(SEEDS))
    last = [len(episode.actions) - 1 for episode in episodes]
    ends: dict[int, str] = {}
    for step in range(max(last) + 1):
        actions = [
            e.actions[step] if step < len(e.actions) else ROBOT.home_command.flat for e in episodes
        ]
        _, _, terminated, truncated, _ = envs.step(np.array(actions, dtype=np.float32))
        for number, over in enumerate(terminated | truncated):
            if step <= last[number]:
                assert over == (step == last[number])
            if step == last[number]:
                # The environment resets itself at the next step.
                ends[number] = envs.call("state_hash")[number]
    envs.close()
    assert ends == {number: episode.state_hash for number, episode in enumerate(episodes)}
