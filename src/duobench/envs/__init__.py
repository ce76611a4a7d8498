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
    from duobench.envs.episode_state import (
        EpisodeState as EpisodeState,
        StateError as StateError,
    )
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
    from duobench.envs.registration import (
        env_id as env_id,
        make as make,
        register as register,
    )
    from duobench.envs.sim_env import SimEnv as SimEnv, sim_of as sim_of
else:
    __getattr__, __dir__, __all__ = lazy(
        __name__,
        {
            "duobench.envs.action_modes": ["ACTION_MODES"],
            "duobench.envs.action_wrappers": [
                "ActionChunks",
                "BinaryGripper",
                "CartesianActions",
                "RelativeCartesianActions",
                "RelativeJointActions",
            ],
            "duobench.envs.batch_env": ["BatchEnv"],
            "duobench.envs.config": ["EnvConfig"],
            "duobench.envs.duo_env": [
                "ClosedEnvError",
                "DuoEnv",
                "DuoWrapper",
                "ResetNeededError",
                "base_of",
            ],
            "duobench.envs.episode_state": ["EpisodeState", "StateError"],
            "duobench.envs.episode_wrappers": [
                "RandomizedReset",
                "TaskStages",
                "TimeLimit",
            ],
            "duobench.envs.observation_wrappers": [
                "Cameras",
                "FlatObservations",
                "ObjectStates",
            ],
            "duobench.envs.protocol": ["make_env"],
            "duobench.envs.registration": ["env_id", "make", "register"],
            "duobench.envs.sim_env": ["SimEnv", "sim_of"],
        },
    )
