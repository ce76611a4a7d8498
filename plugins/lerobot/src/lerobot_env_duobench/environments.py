"""DuoBench's tasks as environments of LeRobot: what `--env.…` chooses, and what follows."""

from __future__ import annotations

import multiprocessing
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.envs import EnvConfig
from lerobot.envs.utils import _LazyAsyncVectorEnv, freeze_after_episode_end
from lerobot.processor import DeviceProcessorStep, PolicyProcessorPipeline

import duobench
from duobench.core.errors import OptionError, check_known
from duobench.core.lerobot_keys import ACTION, IMAGE_PREFIX, OBJECT_STATE, STATE
from duobench.core.randomness import episode_seed
from duobench.core.types import CONTROL_HZ
from duobench.envs import state_labels
from duobench.envs.action_labels import LABELS
from duobench.envs.state_labels import SHOWN
from duobench.tasks import catalog
from duobench.tasks.object_state import ENVIRONMENT_STATE
from duobench.world.robot.cameras import POLICY_CAMERAS
from duobench.world.robot.gripper import DEFAULT_GRIPPER
from duobench.world.robot.mounts import DEFAULT_MOUNT

ALL = "all"
AGENT = "agent_pos"


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
    action: str = "joint"
    """Meaning of the policy's actions, as `duobench export lerobot --action` names it."""
    state: tuple[str, ...] = ()
    """What follows joints and openings in the state of the robot, such as tcp_pose."""
    object_state: bool = False
    """Whether the policy sees the numbers of objects, which are privileged."""
    render_size: tuple[int, int] = (240, 320)
    """Height and width of the videos in pixels."""
    episode_length: int | None = None
    """Control steps after which an episode ends; None takes the task's."""
    gripper: str = DEFAULT_GRIPPER
    """Gripper on both arms, such as franka_hand, or module:ATTRIBUTE."""
    mount: str = DEFAULT_MOUNT
    """How the arms are mounted: duo or wide."""
    suite_seeds: bool = True
    """Whether seed n is the n-th episode of DuoBench's evaluation; otherwise it is a seed."""
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # LeRobot's own names, so that recording works too.
        size = (self.image_size, self.image_size, 3)
        check_known("action mode of an export", self.action, LABELS)
        for part in self.state:
            check_known("part of a state", part, [each.value for each in SHOWN])
        numbers = len(LABELS[self.action].names)
        seen = len(state_labels.names_of(self.state))
        self.features = {
            ACTION: PolicyFeature(FeatureType.ACTION, (numbers,)),
            AGENT: PolicyFeature(FeatureType.STATE, (seen,)),
        }
        self.features_map = {ACTION: ACTION, AGENT: STATE}
        if self.object_state:
            shape = (self._object_numbers(),)
            self.features[ENVIRONMENT_STATE] = PolicyFeature(FeatureType.ENV, shape)
            self.features_map[ENVIRONMENT_STATE] = OBJECT_STATE
        for camera in self.cameras:
            key = f"{IMAGE_PREFIX}{camera}"
            self.features[key] = PolicyFeature(FeatureType.VISUAL, size)
            self.features_map[key] = key

    def _object_numbers(self) -> int:
        """Count the numbers of the tasks' object states."""
        counts = {
            task: len(catalog.get(task).object_state.names) for task in self.tasks
        }
        if len(set(counts.values())) > 1:
            listed = ", ".join(f"{task} {count}" for task, count in counts.items())
            raise OptionError(
                f"A policy takes object states of one size, those of the tasks have {listed}; "
                "evaluate task by task."
            )
        return next(iter(counts.values()))

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
            "action_mode": LABELS[self.action].mode.name,
            "object_state": self.object_state,
            "render_mode": "rgb_array",
            "render_size": tuple(self.render_size),
            "horizon": self.episode_length,
            "gripper": self.gripper,
            "mount": self.mount,
        }

    def get_env_processors(
        self,
    ) -> tuple[PolicyProcessorPipeline, PolicyProcessorPipeline]:
        """What happens to observations and actions between environment and policy.

        Actions become float32. Those of a policy with `use_amp` are bfloat16, which NumPy, and with
        it LeRobot's loop, does not know.
        """
        as_float32 = DeviceProcessorStep(device="cpu", float_dtype="float32")
        return PolicyProcessorPipeline(steps=[]), PolicyProcessorPipeline(
            steps=[as_float32]
        )

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
        one = partial(
            make, task, self.suite_seeds, self.gym_kwargs, self.action, self.state
        )
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


def make(
    task: str,
    suite_seeds: bool,
    options: dict[str, Any],
    action: str = "joint",
    state: tuple[str, ...] = (),
) -> gym.Env:
    """An environment as LeRobot's loop uses it.

    Args:
        task: Id of the task, or its import path "module:ATTRIBUTE".
        suite_seeds: Whether seed n is the n-th episode of the evaluation.
        options: As `duobench.make` takes them.
        action: Meaning of the actions; see `DuoBenchEnv`.
        state: What follows joints and openings in the state of the robot.
    """
    name = catalog.get(task).id
    return Episodes(duobench.make(task, **options), name, suite_seeds, action, state)


class Episodes(gym.Wrapper):
    """Plays episode n of a task when it is reset with seed n, and tells the instruction.

    Actions and the state of the robot are those of a data set for learning.
    """

    def __init__(
        self,
        env: gym.Env,
        task: str,
        suite_seeds: bool,
        action: str,
        state: tuple[str, ...],
    ) -> None:
        super().__init__(env)
        self._labels, self._state = LABELS[action], state
        if self._labels.rotation_numbers is not None:
            shape = (len(self._labels.names),)
            self.action_space = gym.spaces.Box(-np.inf, np.inf, shape, np.float32)
        seen: Any = env.observation_space
        parts = [seen[AGENT], *(seen[part] for part in state)]
        low = np.concatenate([part.low for part in parts])
        high = np.concatenate([part.high for part in parts])
        space = gym.spaces.Box(low, high, dtype=np.float32)
        self.observation_space = gym.spaces.Dict({**seen.spaces, AGENT: space})
        self.task = task
        """Id of the task."""
        self.task_description = ""
        """The instruction of the running episode."""
        self._suite_seeds = suite_seeds

    @property
    def _max_episode_steps(self) -> int:
        """Control steps after which an episode ends; LeRobot asks for it by this name."""
        return self.env.get_wrapper_attr("_max_episode_steps")

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> Any:
        """Begin an episode."""
        if seed is not None and self._suite_seeds:
            seed = episode_seed(self.task, seed)
        observation, info = self.env.reset(seed=seed, options=options)
        self.task_description = info["instruction"]
        return self._seen(observation), info

    def step(self, action: Any) -> Any:
        """Advance one control step."""
        (numbers,) = self._labels.to_actions(np.asarray(action)[None])
        observation, *rest = self.env.step(numbers)
        return self._seen(observation), *rest

    def _seen(self, observation: dict[str, Any]) -> dict[str, Any]:
        return {**observation, AGENT: state_labels.shown(observation, self._state)}
