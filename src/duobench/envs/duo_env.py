"""The base environment: two arms, simulated or real, without reward, end or randomness.

What makes it a benchmark task is wrapped around it: random resets, stages, a time limit, action
modes, action chunks, cameras. Each wrapper works on its own; `envs.protocol` puts them together.
What wrappers have in common stands here too.
"""

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import ArrayLike, NDArray

from duobench.core.backend import CameraGeometry, DuoBackend
from duobench.core.errors import (
    BackendError,
    DuoBenchError,
    OptionError,
    escaped,
)
from duobench.core.types import CONTROL_HZ, Array, DuoCommand
from duobench.envs import spaces
from duobench.envs.action_modes import ActionMode
from duobench.envs.config import EnvConfig, checked_reset_options, checked_seed
from duobench.envs.episode_state import EpisodeState, StateError
from duobench.tasks.task import Task
from duobench.world.objects.segmentation import segmentation_ids

Observation = dict[str, Any]
Info = dict[str, Any]
ResetOptions = dict[str, Any] | None
Start = tuple[Observation, Info]
"""First observation and info of an episode, or of one that continues from a saved state."""
Transition = tuple[Observation, SupportsFloat, bool, bool, Info]
"""Observation, reward, terminated, truncated, info."""

ROUNDING = 1e-6
"""A target that is changed by less than this was rounded to float32, not clipped."""
MAX_IMAGE_AGE_SECONDS = 0.1
"""Oldest image that an episode goes on with: three control steps, after which a camera at 30 Hz has
missed two images."""
TRUNCATION_REASON = "truncation_reason"
"""Key of `info` that says why the arms ended an episode; only there where they did."""


class ResetNeededError(DuoBenchError, gym.error.ResetNeeded):
    """A step outside an episode: before the first reset, or after the last step."""


class ClosedEnvError(DuoBenchError, gym.error.ClosedEnvironmentError):
    """A call of an environment that was closed before."""

    @classmethod
    def check(cls, is_closed: bool) -> None:
        """Raise it if an environment is closed."""
        if is_closed:
            raise cls("This environment was closed; make a new one.")


class DuoEnv(gym.Env[Observation, Any]):
    """Joint targets in, proprioception out.

    An action is 16 numbers: left joints 1-7 (absolute targets in radians), left gripper opening
    (0 closed to 1 open), then the same on the right. The targets are approached linearly over one
    control step of 1/30 s. Finite targets outside the ranges are clipped, and so are joint targets
    further from the last ones than the joint moves in one control step at its speed limit;
    `info["clipped"]` (16 booleans) says which. Grippers move at the speed of their motor.
    `info["sent"]` (16,) is the command that was really sent.

    An observation holds `agent_pos` (16,), measured, in the order of an action, and `tcp_pose`
    (14,), the left and the right tool centre point in the table frame, x y z qx qy qz qw each.

    The reward is zero. An episode ends only where the arms cannot go on: a person or the backend
    holds them, something is wrong with arms, grippers or cameras, or the image of a camera is older
    than `MAX_IMAGE_AGE_SECONDS`. Then both arms hold, the step is truncated, and
    `info["truncation_reason"]` says why; nothing moves before the next reset, which brings the arms
    home. A subclass says how else an episode begins.

    Args:
        backend: The arms.
        task: What they are to do.

    Raises:
        BackendError: The arms cannot be reached.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium's way to declare it
        "render_modes": ["rgb_array"],
        "render_fps": round(CONTROL_HZ),
    }

    action_mode = "joint"
    """Name of what an action means; `env.get_wrapper_attr` finds that of the outermost wrapper."""

    def __init__(self, backend: DuoBackend, task: Task) -> None:
        backend.start()
        self.backend = backend
        """The arms."""
        self.definition = task
        """The task as data."""
        self.reference = ""
        """Id or import path by which the task was given; empty if it was given as an object."""
        self.config: EnvConfig | None = None
        """Configuration of the environment; None where wrappers were put together by hand."""
        self._instruction = task.instruction
        self.closed = False
        """Whether `close` was called."""
        self._running = False
        self._limits = backend.limits
        self._sent = backend.last_command.flat
        self.requested = self._sent
        """The command (16,) of the last step before limits changed it."""
        self.action_space = spaces.joint_actions(self._limits)
        self.observation_space = spaces.observations(self._limits)

    @property
    def task(self) -> str:
        """Id of the task."""
        return self.definition.id

    @property
    def task_description(self) -> str:
        """The instruction of this episode; before the first reset, with variants left open."""
        return self._instruction

    @property
    def subinstructions(self) -> dict[int, str]:
        """Instruction at each stage 0 to n-1 to reach the next one."""
        return {
            number: stage.instruction
            for number, stage in enumerate(self.definition.stages)
        }

    @property
    def cameras(self) -> dict[str, CameraGeometry]:
        """Lens and place at this step of each camera whose images are observed; here none."""
        return {}

    @property
    def segmentation_ids(self) -> dict[str, int]:
        """Number in a segmentation of each part of the scene: always the same of a task."""
        return segmentation_ids(self.definition.props)

    @property
    def _max_episode_steps(self) -> int:
        """The task's horizon in control steps; a time limit enforces it."""
        return self.definition.horizon

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> Start:
        """Begin an episode.

        Args:
            seed: Seeds `np_random`.
            options: What a subclass takes; this class has none.

        Returns:
            Observation and info: `instruction`, `clipped`, `sent`, and what the subclass adds.

        Raises:
            OptionError: The seed is no whole number from 0 on, or the options are no dict.
            UnknownNameError: There is no such option.
            BackendError: The arms cannot get home.
            ClosedEnvError: The environment was closed; so do the other methods.
        """
        ClosedEnvError.check(self.closed)
        options = checked_reset_options(options)
        super().reset(seed=checked_seed(seed))
        self._running = False
        more = self._begin(options)
        self._sent = self.requested = self.backend.last_command.flat
        self._running = True
        return self._observation(), {**self._info(), **more}

    def _begin(self, options: Mapping[str, Any]) -> Info:
        """Bring arms and objects to the start of an episode; what info holds beside the rest."""
        checked_reset_options(options, ())
        self.backend.home()
        return {}

    def check_action(self, action: Any) -> Array:
        """The action as 16 float64 numbers, without executing it."""
        return spaces.checked_action(action, spaces.JOINT_NAMES)

    def hold_action(self) -> Array:
        """The action that leaves the command of both arms as it is."""
        return self.backend.last_command.flat

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, Info]:
        """Advance one control step; truncated where the arms cannot go on, see the class.

        Args:
            action: 16 numbers, see the class.

        Raises:
            ActionError: The action has another shape, or holds NaN or infinity. Nothing was moved.
            ResetNeededError: No episode is running.
            BackendError: The arms cannot go on; the episode is over.
        """
        ClosedEnvError.check(self.closed)
        if not self._running:
            raise ResetNeededError("No episode is running; call reset first.")
        targets = self.check_action(action)
        self.requested = targets
        measured, velocities = self.backend.read().flat, self.backend.joint_velocities()
        within = self._limits.clip(targets, self._sent, measured, velocities)
        reason = self._truncation_reason()
        if reason is None:
            try:
                self._sent = self.backend.command(DuoCommand.from_flat(within)).flat
            except BackendError:
                self._running = False
                raise
            reason = self._truncation_reason()
        info = self._info(np.abs(self._sent - targets) > ROUNDING)
        if reason is not None:
            self._running = False
            info[TRUNCATION_REASON] = reason
        return self._observation(), 0.0, False, reason is not None, info

    def observe(self) -> Observation:
        """The observation of this moment, without a step."""
        return self._observation()

    def _truncation_reason(self) -> str | None:
        """Reason why the arms hold and cannot continue; None if they can."""
        backend = self.backend
        if backend.held is None and (
            fault := backend.health() or _stale(backend.image_ages())
        ):
            backend.hold(fault)
        return backend.held

    def _info(self, clipped: NDArray[np.bool_] | None = None) -> Info:
        return {
            "instruction": self._instruction,
            "clipped": np.zeros(len(self._sent), dtype=bool)
            if clipped is None
            else clipped,
            "sent": self._sent.copy(),
        }

    def _observation(self) -> Observation:
        state = self.backend.read()
        return {
            "agent_pos": state.flat.astype(np.float32),
            "tcp_pose": state.tcp_poses.astype(np.float32).ravel(),
        }

    def close(self) -> None:
        """Stop the arms and let go of them; closing twice is harmless."""
        self.closed = True
        self.backend.stop()
        self.backend.close()


def _stale(ages: Mapping[str, float]) -> str | None:
    """Which images are too old, if any is."""
    old = [
        f"{camera} {age:.2f} s"
        for camera, age in ages.items()
        if not age <= MAX_IMAGE_AGE_SECONDS  # an age that is no number is no young one
    ]
    limit = f"at most {MAX_IMAGE_AGE_SECONDS:g} s is right"
    return f"Images are too old: {', '.join(old)}; {limit}." if old else None


def base_of(env: gym.Env) -> DuoEnv:
    """The `DuoEnv` under all wrappers.

    Raises:
        TypeError: The environment wraps no `DuoEnv`.
    """
    base = env.unwrapped
    if not isinstance(base, DuoEnv):
        raise TypeError(
            f"Expected a DuoEnv, wrapped or not, got {type(base).__name__}."
        )
    return base


INSIDE = {
    "sim": "unwrapped.simulation",
    "model": "unwrapped.simulation.model",
    "data": "unwrapped.simulation.data",
    "seed": "reset(seed=0)",
    "horizon": "spec.max_episode_steps",
}
"""Places of things that people look for on the outermost environment."""


def _by_name(reset: Callable[..., Start]) -> Callable[..., Start]:
    """A reset that says so where arguments are given without their names."""

    @wraps(reset)
    def checked(self: gym.Env, *wrong: Any, **named: Any) -> Start:
        if wrong:
            raise OptionError(
                f"reset takes its arguments by name: reset(seed={wrong[0]!r})."
            )
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
    """Wrapper around a `DuoEnv`, with other wrappers between them or not.

    Gymnasium's wrappers do not pass attributes on. Those that tools of the field look for on the
    outermost environment are passed on here.

    Args:
        arguments: What the wrapper was made with, so that it can be made again.

    Raises:
        TypeError: There is no `DuoEnv` inside.
    """

    made_from: EnvSpec | None = None
    """Specification from which Gymnasium makes the environment, up to this wrapper; None if it adds
    the wrapper to what it makes of those inside."""

    def __init__(self, env: gym.Env, **arguments: Any) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, **arguments)
        gym.Wrapper.__init__(self, env)
        base_of(env)  # rejects any other environment

    @property
    def spec(self) -> EnvSpec | None:
        """Gymnasium's specification of the environment; None where it was put together by hand."""
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
        """Configuration of the environment; None where it was put together by hand."""
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

    @property
    def cameras(self) -> dict[str, CameraGeometry]:
        """Lens and place at this step of each camera whose images are observed, by name.

        They are those of the present state, also where shifted sensors show an older image.
        """
        return self.env.get_wrapper_attr("cameras")

    @property
    def segmentation_ids(self) -> dict[str, int]:
        """Number in a segmentation of each part of the scene, by name."""
        return self.base.segmentation_ids

    def save_state(self) -> EpisodeState:
        """The whole state of the running episode; see `SimEnv.save_state`."""
        return self.env.get_wrapper_attr("save_state")()

    def state_hash(self) -> str:
        """SHA-256 of the whole state of the running episode; equal states, equal hashes."""
        return self.save_state().hash

    def observe(self) -> Observation:
        """The observation of this moment, without a step."""
        return self.env.get_wrapper_attr("observe")()

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

    def __init__(
        self, env: gym.Env, added: Mapping[str, gym.Space], **arguments: Any
    ) -> None:
        super().__init__(env, **arguments)
        inner = env.observation_space
        if not isinstance(inner, gym.spaces.Dict):
            raise TypeError(
                f"{type(self).__name__} takes a Dict of observations, got {inner}."
            )
        self.observation_space = gym.spaces.Dict({**inner.spaces, **added})

    def observe(self) -> Observation:
        """The observation of this moment, with what the wrapper adds."""
        return self.observation(super().observe())

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
