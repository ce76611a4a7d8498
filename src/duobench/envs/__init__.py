"""Environments: the arms behind Gymnasium, and the wrappers that make a benchmark task of them."""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.envs.config import ACTION_MODES, EnvConfig
    from duobench.envs.duo_env import DuoEnv, ResetNeededError, base_of
    from duobench.envs.episode_state import EpisodeState, StateError
    from duobench.envs.protocol import make_env
    from duobench.envs.registration import env_id, make, register
    from duobench.envs.sim_env import SimEnv, sim_of
    from duobench.envs.wrappers.action_chunks import ActionChunks
    from duobench.envs.wrappers.base import DuoWrapper
    from duobench.envs.wrappers.binary_gripper import BinaryGripper
    from duobench.envs.wrappers.cameras import Cameras
    from duobench.envs.wrappers.cartesian import CartesianActions
    from duobench.envs.wrappers.randomized_reset import RandomizedReset
    from duobench.envs.wrappers.relative import RelativeCartesianActions, RelativeJointActions
    from duobench.envs.wrappers.task_stages import TaskStages
    from duobench.envs.wrappers.time_limit import TimeLimit

__all__ = [
    "ACTION_MODES",
    "ActionChunks",
    "BinaryGripper",
    "Cameras",
    "CartesianActions",
    "DuoEnv",
    "DuoWrapper",
    "EnvConfig",
    "EpisodeState",
    "RandomizedReset",
    "RelativeCartesianActions",
    "RelativeJointActions",
    "ResetNeededError",
    "SimEnv",
    "StateError",
    "TaskStages",
    "TimeLimit",
    "base_of",
    "env_id",
    "make",
    "make_env",
    "register",
    "sim_of",
]

lazy(__name__)
