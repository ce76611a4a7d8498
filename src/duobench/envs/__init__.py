"""Environments: the arms behind Gymnasium, and the wrappers that make a benchmark task of them."""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.envs.action_modes import ACTION_MODES as ACTION_MODES
    from duobench.envs.config import EnvConfig as EnvConfig
    from duobench.envs.duo_env import DuoEnv as DuoEnv
    from duobench.envs.duo_env import ResetNeededError as ResetNeededError
    from duobench.envs.duo_env import base_of as base_of
    from duobench.envs.episode_state import EpisodeState as EpisodeState
    from duobench.envs.episode_state import StateError as StateError
    from duobench.envs.ids import env_id as env_id
    from duobench.envs.make import make_env as make_env
    from duobench.envs.registration import make as make
    from duobench.envs.registration import register as register
    from duobench.envs.sim_env import SimEnv as SimEnv
    from duobench.envs.sim_env import sim_of as sim_of
    from duobench.envs.wrappers.action_chunks import ActionChunks as ActionChunks
    from duobench.envs.wrappers.base import DuoWrapper as DuoWrapper
    from duobench.envs.wrappers.binary_gripper import BinaryGripper as BinaryGripper
    from duobench.envs.wrappers.cameras import Cameras as Cameras
    from duobench.envs.wrappers.cartesian import CartesianActions as CartesianActions
    from duobench.envs.wrappers.object_states import ObjectStates as ObjectStates
    from duobench.envs.wrappers.randomized_reset import RandomizedReset as RandomizedReset
    from duobench.envs.wrappers.relative import RelativeCartesianActions as RelativeCartesianActions
    from duobench.envs.wrappers.relative import RelativeJointActions as RelativeJointActions
    from duobench.envs.wrappers.task_stages import TaskStages as TaskStages
    from duobench.envs.wrappers.time_limit import TimeLimit as TimeLimit

lazy(__name__)
