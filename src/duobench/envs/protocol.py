"""The evaluation protocol: which wrappers an environment is made of, from the inside out.

Nothing here loads the simulation before it is asked for.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import gymnasium as gym

from duobench.core.errors import OptionError
from duobench.core.references import load
from duobench.envs import action_modes
from duobench.envs.action_wrappers import ActionChunks, BinaryGripper
from duobench.envs.config import VARIED, EnvConfig
from duobench.envs.duo_env import DuoWrapper
from duobench.envs.episode_wrappers import RandomizedReset, TaskStages, TimeLimit
from duobench.envs.observation_wrappers import (
    Cameras,
    FlatObservations,
    ObjectStates,
    Sensing,
)
from duobench.envs.registration import WRAPPERS
from duobench.tasks import catalog
from duobench.tasks.shifts.levels import level_for
from duobench.tasks.shifts.shift import SENSING
from duobench.tasks.task import Task

if TYPE_CHECKING:
    from duobench.envs.sim_env import SimEnv


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
    from duobench.world.sim.opengl import load_engine

    load_engine()
    from duobench.envs.sim_env import SimEnv

    config = EnvConfig.from_options(options)
    base = SimEnv(
        catalog.get(task),
        render_mode=config.render_mode,
        render_size=config.render_size,
        look=config.look,
        speed_fraction=config.speed_fraction,
        shift=config.shift,
        robot=config.robot,
    )
    base.config = config
    base.reference = catalog.reference(task)
    return base


def with_wrappers(env: gym.Env) -> gym.Env:
    """Put the wrappers of the protocol around a base environment.

    Args:
        env: Result of `make_base`. `gymnasium.make` limits it to the registered horizon or to its
            `max_episode_steps`. Here that limit is exchanged for ours, which counts control steps
            in every action mode, is part of an episode's state, and rejects steps after the end.
    """
    from duobench.envs.sim_env import sim_of

    base = sim_of(env)
    config = base.config or EnvConfig()
    horizon = config.horizon
    if isinstance(env, gym.wrappers.TimeLimit):
        limit = env.get_wrapper_attr("_max_episode_steps")
        if horizon is not None and limit not in (horizon, base.definition.horizon):
            raise OptionError(
                f"horizon ({horizon}) and max_episode_steps ({limit}) are two names of one number."
            )
        horizon = horizon or limit
        env = env.env
    if horizon is not None and horizon != base.definition.horizon:
        base.definition = replace(base.definition, horizon=horizon)
        base.config = replace(config, horizon=horizon)
    is_varied = config.instructions == VARIED
    reset = RandomizedReset(env, config.split, varied_instructions=is_varied)
    judged = TaskStages(reset, reward=config.reward)
    stack = stack_on(judged, config, horizon)
    if base.spec is not None:
        stack.made_from = replace(
            base.spec, max_episode_steps=horizon, additional_wrappers=(WRAPPERS,)
        )
    return stack


def stack_on(
    judged: TaskStages,
    config: EnvConfig,
    horizon: int | None,
) -> DuoWrapper:
    """Put the wrappers of a configuration around judged arms.

    The horizon, in control steps, is None for an episode that is never cut off.
    """
    stack: DuoWrapper = judged
    if horizon is not None:
        stack = TimeLimit(stack, horizon)
    for path in action_modes.get(config.action_mode).wrappers:
        stack = load(path, "wrapper", callable)(stack)
    if config.binary_gripper:
        stack = BinaryGripper(stack)
    if config.chunk is not None:
        stack = ActionChunks(stack, config.chunk)
    if config.object_state:
        stack = ObjectStates(stack)
    if config.wanted:
        stack = Cameras(
            stack,
            config.cameras,
            config.image_size,
            config.depth,
            config.segmentation,
            config.image_sizes,
        )
    if level_for(config.shift, SENSING, stack.task):
        stack = Sensing(stack, config.shift)
    if config.flat_obs:
        stack = FlatObservations(stack)
    return stack
