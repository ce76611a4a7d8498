"""DuoBench's tasks as environments of LeRobot: what `--env.…` chooses, and what follows."""

from __future__ import annotations

import multiprocessing
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import gymnasium as gym
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.envs import EnvConfig
from lerobot.envs.utils import _LazyAsyncVectorEnv, freeze_after_episode_end
from lerobot.processor import DeviceProcessorStep, PolicyProcessorPipeline

import duobench
from duobench.core.lerobot_keys import ACTION, IMAGE_PREFIX, STATE
from duobench.core.randomness import episode_seed
from duobench.core.types import CONTROL_HZ, FLAT_SIZE, POLICY_CAMERAS
from duobench.tasks import catalog

ALL = "all"


@EnvConfig.register_subclass("duobench")
@dataclass
class DuoBenchEnv(EnvConfig):
    """Options of DuoBench's environments; the defaults are its evaluation protocol."""

    task: str | None = ALL
    """Ids of tasks or import paths "module:ATTRIBUTE", joined by commas, or "all"."""
    fps: int = int(CONTROL_HZ)
    """Control steps a second; there is one rate."""
    cameras: tuple[str, ...] = POLICY_CAMERAS
    """Cameras that the policy sees."""
    image_size: int = 224
    """Side of their images in pixels."""
    render_size: tuple[int, int] = (240, 320)
    """Height and width of the videos in pixels."""
    episode_length: int | None = None
    """Control steps after which an episode ends; None takes the task's."""
    suite_seeds: bool = True
    """Whether seed n is the n-th episode of DuoBench's evaluation; otherwise it is a seed."""
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # LeRobot's own names, so that recording works too.
        size = (self.image_size, self.image_size, 3)
        self.features = {
            ACTION: PolicyFeature(FeatureType.ACTION, (FLAT_SIZE,)),
            "agent_pos": PolicyFeature(FeatureType.STATE, (FLAT_SIZE,)),
        }
        self.features_map = {ACTION: ACTION, "agent_pos": STATE}
        for camera in self.cameras:
            key = f"{IMAGE_PREFIX}{camera}"
            self.features[key] = PolicyFeature(FeatureType.VISUAL, size)
            self.features_map[key] = key

    @property
    def tasks(self) -> list[str]:
        """Names of the tasks, as `duobench.make` takes them."""
        if self.task in {None, ALL}:
            return list(catalog.names())
        return [name.strip() for name in self.task.split(",")]

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Options of the environments, as `duobench.make` takes them."""
        return {
            "cameras": tuple(self.cameras),
            "image_size": self.image_size,
            "render_mode": "rgb_array",
            "render_size": tuple(self.render_size),
            "horizon": self.episode_length,
        }

    def get_env_processors(self) -> tuple[PolicyProcessorPipeline, PolicyProcessorPipeline]:
        """What happens to observations and actions between environment and policy.

        Actions become float32. Those of a policy with `use_amp` are bfloat16, which NumPy, and with
        it LeRobot's loop, does not know.
        """
        as_float32 = DeviceProcessorStep(device="cpu", float_dtype="float32")
        return PolicyProcessorPipeline(steps=[]), PolicyProcessorPipeline(steps=[as_float32])

    def create_envs(
        self, n_envs: int, use_async_envs: bool = False
    ) -> dict[str, dict[int, gym.vector.VectorEnv]]:
        """The environments of each task, `{task: {0: environments}}`.

        Args:
            n_envs: Environments side by side.
            use_async_envs: Whether each has a process of its own.

        Raises:
            UnknownNameError: There is no such task.
        """
        return {
            catalog.get(task).id: {0: self._vector(task, n_envs, use_async_envs)}
            for task in self.tasks
        }

    def _vector(self, task: str, count: int, in_processes: bool) -> Any:
        one = partial(make, task, self.suite_seeds, self.gym_kwargs)
        if count == 1 or not in_processes:
            return gym.vector.SyncVectorEnv(
                [freeze_after_episode_end(one) for _ in range(count)],
                autoreset_mode=gym.vector.AutoresetMode.NEXT_STEP,
            )
        # A process of the fork server would import torch and LeRobot again, for each task.
        server = multiprocessing.get_context("forkserver")
        server.set_forkserver_preload(
            ["lerobot_env_duobench", "duobench.envs.protocol", "duobench.envs.sim_env"]
        )
        env = one()
        spaces = env.observation_space, env.action_space, env.metadata
        env.close()
        return _LazyAsyncVectorEnv([one] * count, *spaces)


def make(task: str, suite_seeds: bool, options: dict[str, Any]) -> gym.Env:
    """An environment as LeRobot's loop uses it.

    Args:
        task: Id of the task, or its import path "module:ATTRIBUTE".
        suite_seeds: Whether seed n is the n-th episode of the evaluation.
        options: As `duobench.make` takes them.
    """
    return Episodes(duobench.make(task, **options), catalog.get(task).id, suite_seeds)


class Episodes(gym.Wrapper):
    """Plays episode n of a task when it is reset with seed n, and tells the instruction."""

    def __init__(self, env: gym.Env, task: str, suite_seeds: bool) -> None:
        super().__init__(env)
        self.task = task
        """Id of the task."""
        self.task_description = ""
        """The instruction of the running episode."""
        self._suite_seeds = suite_seeds

    @property
    def _max_episode_steps(self) -> int:
        """Control steps after which an episode ends; LeRobot asks for it by this name."""
        return self.env.get_wrapper_attr("_max_episode_steps")

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begin an episode."""
        if seed is not None and self._suite_seeds:
            seed = episode_seed(self.task, seed)
        observation, info = self.env.reset(seed=seed, options=options)
        self.task_description = info["instruction"]
        return observation, info
