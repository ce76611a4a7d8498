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
    from duobench.envs.wrappers import (
        ActionChunks,
        BinaryGripper,
        Cameras,
        CartesianActions,
        RandomizedReset,
        RelativeCartesianActions,
        RelativeJointActions,
        TaskStages,
        TimeLimit,
    )
    from duobench.envs.wrappers.base import DuoWrapper

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
