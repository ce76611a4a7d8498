"""The evaluation protocol: which wrappers an environment is made of.

From the inside out: the base environment, random resets, stages, the horizon, the action mode,
binary grippers, action chunks, object states, cameras.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium as gym

from duobench.envs.config import VARIED, EnvConfig
from duobench.envs.ids import WRAPPERS
from duobench.envs.sim_env import SimEnv, sim_of
from duobench.envs.stacking import stack_on
from duobench.envs.wrappers.base import DuoWrapper
from duobench.envs.wrappers.randomized_reset import RandomizedReset
from duobench.envs.wrappers.task_stages import TaskStages
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
    base = make_base(task, **options)
    return with_wrappers(gym.wrappers.TimeLimit(base, base.definition.horizon))


def make_base(task: str | Task, **options: Any) -> SimEnv:
    """The environment of `make_env` without its wrappers."""
    config = EnvConfig.from_options(options)
    base = SimEnv(
        catalog.get(task),
        render_mode=config.render_mode,
        render_size=config.render_size,
        look=config.look,
        speed_fraction=config.speed_fraction,
    )
    base.config = config
    return base


def with_wrappers(env: gym.Env) -> gym.Env:
    """Put the wrappers of the protocol around a base environment.

    Args:
        env: What `make_base` gave. `gymnasium.make` limits it to the registered horizon or to its
            `max_episode_steps`. Here that limit is exchanged for ours, which counts control steps
            whatever an action is, is part of an episode's state, and refuses steps after the end.
    """
    base = sim_of(env)
    config = base.config or EnvConfig()
    horizon = config.horizon
    if isinstance(env, gym.wrappers.TimeLimit):
        horizon = horizon or env.get_wrapper_attr("_max_episode_steps")
        env = env.env
    if horizon is not None and horizon != base.definition.horizon:
        base.definition = replace(base.definition, horizon=horizon)
        base.config = replace(config, horizon=horizon)
    stack = _stack(env, config, horizon)
    if base.spec is not None:
        stack.made_from = replace(
            base.spec, max_episode_steps=horizon, additional_wrappers=(WRAPPERS,)
        )
    return stack


def _stack(env: gym.Env, config: EnvConfig, horizon: int | None) -> DuoWrapper:
    is_varied = config.instructions == VARIED
    judged = TaskStages(RandomizedReset(env, config.split, varied_instructions=is_varied))
    return stack_on(judged, config, horizon)
