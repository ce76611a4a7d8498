"""Environments: the arms behind Gymnasium, and the wrappers that make a benchmark task of them."""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.envs.action_modes import ACTION_MODES as ACTION_MODES
    from duobench.envs.action_wrappers import (
        ActionChunks as ActionChunks,
        BinaryGripper as BinaryGripper,
        CartesianActions as CartesianActions,
        RelativeCartesianActions as RelativeCartesianActions,
        RelativeJointActions as RelativeJointActions,
    )
    from duobench.envs.batch_env import BatchEnv as BatchEnv
    from duobench.envs.config import EnvConfig as EnvConfig
    from duobench.envs.duo_env import (
        ClosedEnvError as ClosedEnvError,
        DuoEnv as DuoEnv,
        DuoWrapper as DuoWrapper,
        ResetNeededError as ResetNeededError,
        base_of as base_of,
    )
    from duobench.envs.episode_state import EpisodeState as EpisodeState, StateError as StateError
    from duobench.envs.episode_wrappers import (
        RandomizedReset as RandomizedReset,
        TaskStages as TaskStages,
        TimeLimit as TimeLimit,
    )
    from duobench.envs.observation_wrappers import (
        Cameras as Cameras,
        FlatObservations as FlatObservations,
        ObjectStates as ObjectStates,
    )
    from duobench.envs.protocol import make_env as make_env
    from duobench.envs.registration import env_id as env_id, make as make, register as register
    from duobench.envs.sim_env import SimEnv as SimEnv, sim_of as sim_of

lazy(__name__)
