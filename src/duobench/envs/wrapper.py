"""What every wrapper of this package has in common."""

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from duobench.envs import spaces
from duobench.envs.action_modes import ActionMode
from duobench.envs.config import EnvConfig
from duobench.envs.duo_env import DuoEnv, Start, base_of
from duobench.envs.episode_state import EpisodeState, StateError
from duobench.errors import OptionError, escaped
from duobench.types import Array

INSIDE = {
    "sim": "unwrapped.simulation",
    "model": "unwrapped.simulation.model",
    "data": "unwrapped.simulation.data",
    "seed": "reset(seed=0)",
    "horizon": "spec.max_episode_steps",
}
"""Where things are that people look for on the outermost environment."""


def _by_name(reset: Callable[..., Start]) -> Callable[..., Start]:
    """A reset that says so where arguments are given without their names."""

    @wraps(reset)
    def checked(self: gym.Env, *wrong: Any, **named: Any) -> Start:
        if wrong:
            raise OptionError(f"reset takes its arguments by name: reset(seed={wrong[0]!r}).")
        return reset(self, **named)

    return checked


def _of_a_state(restore: Callable[..., Start]) -> Callable[..., Start]:
    """A restoration that says so where it gets something else than a saved state."""

    @wraps(restore)
    def checked(self: gym.Env, state: EpisodeState) -> Start:
        if not isinstance(state, EpisodeState):
            got = escaped(repr(state))[:80]
            raise StateError(f"A saved state comes from env.save_state(), got {got}.")
        return restore(self, state)

    return checked


class DuoWrapper(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """A wrapper around a `DuoEnv`, whatever stands between.

    Gymnasium's wrappers do not pass attributes on. Those that tools of the field look for on the
    outermost environment are passed on here.

    Args:
        arguments: What the wrapper was made with, so that it can be made again.

    Raises:
        TypeError: There is no `DuoEnv` inside.
    """

    made_from: EnvSpec | None = None
    """What Gymnasium makes the environment from, up to this wrapper; None if it adds the wrapper to
    what it makes of those inside."""

    def __init__(self, env: gym.Env, **arguments: Any) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, **arguments)
        gym.Wrapper.__init__(self, env)
        base_of(env)  # rejects any other environment

    @property
    def spec(self) -> EnvSpec | None:
        """What Gymnasium makes the environment from; None where it was put together by hand."""
        return self.made_from or super().spec

    def __getattr__(self, name: str) -> Any:
        place, inner = INSIDE.get(name, ""), vars(self).get("env")
        while inner is not None and not place:
            if name in dir(type(inner)) or name in vars(inner):
                place = f"get_wrapper_attr({name!r})"
            inner = vars(inner).get("env")
        hint = f"; try env.{place}" if place else ""
        raise AttributeError(f"A wrapper has no attribute {name!r}{hint}.")

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.reset = _by_name(cls.reset)
        cls.restore_state = _of_a_state(cls.restore_state)

    @property
    def config(self) -> EnvConfig | None:
        """What was chosen about the environment; None where it was put together by hand."""
        return self.base.config

    @property
    def base(self) -> DuoEnv:
        """The innermost environment."""
        return base_of(self)

    @property
    def task(self) -> str:
        """Id of the task."""
        return self.base.task

    @property
    def task_description(self) -> str:
        """The instruction of this episode."""
        return self.base.task_description

    def save_state(self) -> EpisodeState:
        """The whole state of the running episode; see `SimEnv.save_state`."""
        return self.env.get_wrapper_attr("save_state")()

    def state_hash(self) -> str:
        """SHA-256 of the whole state of the running episode; equal states, equal hashes."""
        return self.save_state().hash

    def restore_state(self, state: EpisodeState) -> Start:
        """Continue from a saved state; see `SimEnv.restore_state`."""
        return self.env.get_wrapper_attr("restore_state")(state)

    @property
    def _max_episode_steps(self) -> int:
        """Control steps after which an episode is cut off."""
        return self.env.get_wrapper_attr("_max_episode_steps")


class ObservingWrapper(DuoWrapper, gym.ObservationWrapper):
    """A wrapper that changes the observation; `observation` of a subclass does it.

    What it gives follows from the state of the arms and objects alone, so it is the same after a
    step and after the state was restored.

    Args:
        added: Spaces of the entries that it adds, by key.
        arguments: What the wrapper was made with.
    """

    def __init__(self, env: gym.Env, added: Mapping[str, gym.Space], **arguments: Any) -> None:
        super().__init__(env, **arguments)
        inner = env.observation_space
        if not isinstance(inner, gym.spaces.Dict):
            raise TypeError(f"{type(self).__name__} takes a Dict of observations, got {inner}.")
        self.observation_space = gym.spaces.Dict({**inner.spaces, **added})

    def restore_state(self, state: EpisodeState) -> Start:
        """Continue from a saved state, and observe."""
        observation, info = super().restore_state(state)
        return self.observation(observation), info


class ActionModeWrapper(DuoWrapper):
    """A wrapper that takes the actions of a mode; a subclass says which, and what they mean."""

    mode: ActionMode

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        self.action_space = self.mode.space(self.base.backend.limits)

    @property
    def action_mode(self) -> str:
        """Name of what an action means."""
        return self.mode.name

    def check_action(self, action: Any) -> Array:
        """The action as float64 numbers, as many as the mode has, without executing it."""
        return spaces.checked_action(action, self.mode.names)
