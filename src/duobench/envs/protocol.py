"""The evaluation protocol: which wrappers an environment is made of.

From the inside out: the base environment, random resets, stages, the horizon, the action mode,
binary grippers, action chunks, cameras.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium as gym

from duobench.envs.config import EnvConfig
from duobench.envs.sim_env import SimEnv
from duobench.envs.wrappers.action_chunks import ActionChunks
from duobench.envs.wrappers.binary_gripper import BinaryGripper
from duobench.envs.wrappers.cameras import Cameras
from duobench.envs.wrappers.cartesian import CartesianActions
from duobench.envs.wrappers.randomized_reset import RandomizedReset
from duobench.envs.wrappers.relative import RelativeCartesianActions, RelativeJointActions
from duobench.envs.wrappers.task_stages import TaskStages
from duobench.envs.wrappers.time_limit import TimeLimit
from duobench.tasks import catalog
from duobench.tasks.task import Task


def make_env(task: str | Task, **options: Any) -> gym.Env:
    """An environment of a task; without options, that of the evaluation protocol.

    Args:
        task: A task, its id, or its import path "module:ATTRIBUTE".
        options: The fields of `EnvConfig`, as `EnvConfig.from_options` takes them.

    Returns:
        The environment; `env.get_wrapper_attr("config")` is its `EnvConfig`.

    Raises:
        UnknownNameError: There is no such task, option, camera, mode, split or look.
        OptionError: A value is invalid.
    """
    config = EnvConfig.from_options(options)
    definition = catalog.get(task)
    if config.horizon is not None:
        definition = replace(definition, horizon=config.horizon)
    base = SimEnv(
        definition,
        render_mode=config.render_mode,
        render_size=config.render_size,
        look=config.look,
    )
    base.config = config
    env: gym.Env = TimeLimit(TaskStages(RandomizedReset(base, config.split)), definition.horizon)
    if config.action_mode == "joint_relative":
        env = RelativeJointActions(env)
    elif config.action_mode != "joint":
        env = CartesianActions(env)
    if config.action_mode == "cartesian_relative":
        env = RelativeCartesianActions(env)
    if config.binary_gripper:
        env = BinaryGripper(env)
    if config.chunk is not None:
        env = ActionChunks(env, config.chunk)
    if config.cameras:
        env = Cameras(env, config.cameras, config.image_size)
    return env
