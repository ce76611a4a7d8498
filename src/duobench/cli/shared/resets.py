"""Environments that are reset, as commands show them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from duobench.envs.config import checked_seed
from duobench.tasks.task import Task
from duobench.world.looks.catalog import DEFAULT
from duobench.world.robot.frames import robot_with
from duobench.world.robot.gripper import DEFAULT_GRIPPER

if TYPE_CHECKING:
    from duobench.envs.sim_env import SimEnv
    from duobench.world.sim.layout import Layout


def sample_layouts(task: Task, seeds: Iterable[int]) -> list[Layout]:
    """Sample the layouts that seeds give in one environment."""
    from duobench.envs import RandomizedReset
    from duobench.envs.sim_env import SimEnv

    env = SimEnv(task)
    start = RandomizedReset(env)
    found: list[Layout] = []
    for seed in seeds:
        start.reset(seed=seed)
        found.append(env.layout)
    return found


def reset_env(
    task: Task,
    seed: int,
    look: str = DEFAULT,
    gripper: str = DEFAULT_GRIPPER,
) -> SimEnv:
    """An environment with the layout that a seed gives, tried on the simulated objects."""
    from duobench.envs import RandomizedReset
    from duobench.envs.sim_env import SimEnv

    checked_seed(seed)
    env = SimEnv(task, look=look, robot=robot_with(gripper))
    env.make_judge()  # an error where a stage names what is not there
    RandomizedReset(env).reset(seed=seed)
    return env
