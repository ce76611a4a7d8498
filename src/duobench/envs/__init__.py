"""Environments: the arms behind Gymnasium, and the wrappers that make a benchmark task of them."""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.envs.action_modes import ACTION_MODES as ACTION_MODES
    from duobench.envs.action_wrappers import ActionChunks as ActionChunks
    from duobench.envs.action_wrappers import BinaryGripper as BinaryGripper
    from duobench.envs.action_wrappers import CartesianActions as CartesianActions
    from duobench.envs.action_wrappers import RelativeCartesianActions as RelativeCartesianActions
    from duobench.envs.action_wrappers import RelativeJointActions as RelativeJointActions
    from duobench.envs.config import EnvConfig as EnvConfig
    from duobench.envs.duo_env import DuoEnv as DuoEnv
    from duobench.envs.duo_env import ResetNeededError as ResetNeededError
    from duobench.envs.duo_env import base_of as base_of
    from duobench.envs.episode_state import EpisodeState as EpisodeState
    from duobench.envs.episode_state import StateError as StateError
    from duobench.envs.episode_wrappers import RandomizedReset as RandomizedReset
    from duobench.envs.episode_wrappers import TaskStages as TaskStages
    from duobench.envs.episode_wrappers import TimeLimit as TimeLimit
    from duobench.envs.observation_wrappers import Cameras as Cameras
    from duobench.envs.observation_wrappers import ObjectStates as ObjectStates
    from duobench.envs.protocol import make_env as make_env
    from duobench.envs.registration import env_id as env_id
    from duobench.envs.registration import make as make
    from duobench.envs.registration import register as register
    from duobench.envs.sim_env import SimEnv as SimEnv
    from duobench.envs.sim_env import sim_of as sim_of
    from duobench.envs.wrapper import DuoWrapper as DuoWrapper

lazy(__name__)
