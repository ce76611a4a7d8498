"""Libraries of reinforcement learning: a few steps of each algorithm, on numbers and on images."""

import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecVideoRecorder
from torchrl.envs import GymEnv, GymWrapper
from torchrl.envs.utils import check_env_specs

import duobench
from tests.ecosystem.tools import HORIZON, IMAGES, RENDERED, STATES, eyes, flat, nested, states
from tests.envs.tools import TASK, equal

PPO_OPTIONS = {"n_steps": 8, "batch_size": 4, "n_epochs": 1, "device": "cpu"}
SAC_OPTIONS = {"learning_starts": 4, "batch_size": 4, "buffer_size": 64, "device": "cpu"}


@pytest.mark.parametrize("make", [flat, eyes, states], ids=["flat", "eyes", "states"])
def test_the_checker_recommends_smaller_actions_only(make: Callable[[], gym.Env]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # RescaleAction does that, and test_gymnasium.py has it.
        warnings.filterwarnings("ignore", message=".*symmetric and normalized Box action space")
        # Depth and segmentation (height, width) are flattened by the policies that take a Dict.
        warnings.filterwarnings("ignore", message=".*(depth|segmentation).*unconventional shape")
        check_env(make())


@pytest.mark.parametrize(
    ("algorithm", "options", "make"),
    [
        (PPO, PPO_OPTIONS, states),
        (SAC, SAC_OPTIONS, states),
        (PPO, PPO_OPTIONS, flat),
        (SAC, SAC_OPTIONS, flat),
        (PPO, PPO_OPTIONS, eyes),
    ],
    ids=["PPO, states", "SAC, states", "PPO, images", "SAC, images", "PPO, depth"],
)
def test_an_algorithm_learns_a_few_steps(
    algorithm: Any, options: dict[str, Any], make: Callable[[], gym.Env]
) -> None:
    env = make()
    model = algorithm("MultiInputPolicy", env, seed=0, **options).learn(2 * HORIZON)
    action, _ = model.predict(env.reset(seed=0)[0])
    assert action in env.action_space
    env.close()


def test_nested_images_are_refused_by_the_library_in_its_words() -> None:
    with pytest.raises(NotImplementedError, match="Nested observation spaces are not supported"):
        PPO("MultiInputPolicy", nested(), **PPO_OPTIONS)


@pytest.mark.parametrize("make", [flat, eyes], ids=["flat", "eyes"])
@pytest.mark.parametrize("method", [None, "spawn", "forkserver"])
def test_environments_in_processes_show_the_same_as_here(
    method: str | None, make: Callable[[], gym.Env]
) -> None:
    several = SubprocVecEnv([make] * 2, start_method=method)
    here = DummyVecEnv([make] * 2)
    action = np.stack([here.envs[0].action_space.sample()] * 2)
    seen = []
    for envs in (several, here):
        envs.seed(3)
        seen.append((envs.reset(), envs.step(action)[0]))
        envs.close()
    assert equal(*seen)


def test_a_vector_environment_is_recorded_as_a_video(tmp_path: Path) -> None:
    inside = DummyVecEnv([partial(states, **RENDERED)])
    envs = VecVideoRecorder(inside, str(tmp_path), lambda step: step == 0, video_length=4)
    envs.reset()
    for _ in range(HORIZON):
        envs.step(np.stack([envs.action_space.sample()]))
    envs.close()
    (video,) = tmp_path.glob("*.mp4")
    assert video.stat().st_size > 1000


@pytest.mark.parametrize(
    "make",
    [
        lambda: GymWrapper(flat()),
        lambda: GymWrapper(nested()),
        lambda: GymWrapper(eyes()),
        lambda: GymEnv(f"duobench/{TASK}-v1", **STATES),
        lambda: GymEnv(f"duobench/{TASK}-v1", **IMAGES, flat_obs=True, frame_skip=2),
        lambda: GymEnv(
            f"duobench/{TASK}-v1", **STATES, **RENDERED, from_pixels=True, pixels_only=False
        ),
    ],
    ids=["flat", "nested", "eyes", "states by id", "flat by id", "rendered"],
)
def test_torchrl_finds_what_the_specs_promise(make: Callable[[], Any]) -> None:
    env = make()
    check_env_specs(env)
    assert env.rollout(2 * HORIZON).batch_size[0] <= HORIZON
    env.close()


def threads(**options: Any) -> gym.vector.VectorEnv:
    return duobench.make_vec(TASK, 2, threads=2, **{**STATES, **options})


@pytest.mark.parametrize("options", [{}, {**IMAGES, "flat_obs": True}], ids=["states", "images"])
def test_torchrl_takes_episodes_on_threads(options: dict[str, Any]) -> None:
    mode = {"autoreset_mode": AutoresetMode.DISABLED}
    env = GymWrapper(threads(vector_kwargs=mode, **options))
    check_env_specs(env)
    done = env.rollout(2 * HORIZON, break_when_any_done=False)["next", "done"]
    assert done.shape == (2, 2 * HORIZON, 1)
    assert done.squeeze(-1).nonzero()[:, 1].tolist() == [HORIZON - 1, 2 * HORIZON - 1] * 2
    env.close()


def test_wrappers_for_vectors_take_episodes_on_threads() -> None:
    lowest, highest = np.float32(-1), np.float32(1)
    envs = gym.wrappers.vector.RescaleAction(threads(), lowest, highest)
    envs = gym.wrappers.vector.RecordEpisodeStatistics(gym.wrappers.vector.FlattenObservation(envs))
    envs.reset(seed=0)
    infos = [envs.step(envs.action_space.sample())[-1] for _ in range(HORIZON)]
    assert infos[-1]["episode"]["l"].tolist() == [HORIZON] * 2
    envs.close()
