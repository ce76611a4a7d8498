"""The evaluation protocol and its options: which wrappers an environment is made of.

From the inside out: the base environment, random resets, stages, the horizon, the action mode,
binary grippers, action chunks, cameras.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType
from typing import Any

import gymnasium as gym

from duobench.envs.sim_env import RENDER_SIZE, SimEnv
from duobench.envs.wrappers.action_chunks import ActionChunks
from duobench.envs.wrappers.binary_gripper import BinaryGripper
from duobench.envs.wrappers.cameras import IMAGE_SIZE, Cameras
from duobench.envs.wrappers.randomized_reset import RandomizedReset
from duobench.envs.wrappers.relative import RelativeJointActions
from duobench.envs.wrappers.task_stages import TaskStages
from duobench.envs.wrappers.time_limit import TimeLimit
from duobench.errors import OptionError, UnknownNameError
from duobench.scene.cameras import NATIVE_HEIGHT, NATIVE_WIDTH, POLICY_CAMERAS
from duobench.tasks import catalog
from duobench.tasks.task import Task

RENDER_MODES = ("rgb_array",)


def _joint(env: gym.Env) -> gym.Env:
    return env


def _cartesian(env: gym.Env) -> gym.Env:
    # Inverse kinematics is loaded where it is used: it doubles the time to the first environment.
    from duobench.envs.wrappers.cartesian import CartesianActions

    return CartesianActions(env)


def _cartesian_relative(env: gym.Env) -> gym.Env:
    from duobench.envs.wrappers.relative import RelativeCartesianActions

    return RelativeCartesianActions(_cartesian(env))


ACTION_MODES: Mapping[str, Callable[[gym.Env], gym.Env]] = MappingProxyType(
    {
        "joint": _joint,
        "joint_relative": RelativeJointActions,
        "cartesian": _cartesian,
        "cartesian_relative": _cartesian_relative,
    }
)
"""What the numbers of an action may mean, by name."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Options:
    """What can be chosen about an environment; the defaults are the evaluation protocol."""

    cameras: bool | str | tuple[str, ...] = True
    """All policy cameras, none, or those named."""
    image_size: int | tuple[int, int] = IMAGE_SIZE
    """Side of a square picture, or height and width, in pixels; at most 720 x 1280."""
    action_mode: str = "joint"
    """One of `ACTION_MODES`."""
    binary_gripper: bool = False
    """Whether openings are rounded to open or closed."""
    chunk: int | None = None
    """Actions in one step, as an array (chunk, n); None takes single actions (n,)."""
    horizon: int | None = None
    """Control steps after which an episode is cut off; None takes the task's."""
    render_mode: str | None = None
    """ "rgb_array", for `render`."""
    render_size: tuple[int, int] = RENDER_SIZE
    """Height and width of what `render` draws, in pixels; at most 720 x 1280."""

    def __post_init__(self) -> None:
        """Refuse values that cannot be."""
        if not isinstance(self.cameras, (bool, Iterable)):
            raise OptionError(
                f"cameras is True, False, the name of a camera or several; got {self.cameras!r}."
            )
        if self.binary_gripper not in (True, False):
            raise OptionError(f"binary_gripper is True or False, got {self.binary_gripper!r}.")
        for name in self.camera_names:
            if name not in POLICY_CAMERAS:
                raise UnknownNameError("camera", name, POLICY_CAMERAS)
        if self.action_mode not in ACTION_MODES:
            raise UnknownNameError("action mode", self.action_mode, ACTION_MODES)
        if self.render_mode is not None and self.render_mode not in RENDER_MODES:
            raise UnknownNameError("render mode", self.render_mode, RENDER_MODES)
        _check_size("image_size", self.image_shape)
        _check_size("render_size", self.render_size)
        for name in ("chunk", "horizon"):
            value = getattr(self, name)
            if value is not None and not _is_count(value):
                raise OptionError(f"{name} is a positive whole number, got {value!r}.")

    @staticmethod
    def of(options: Mapping[str, Any]) -> Options:
        """From keyword arguments.

        Raises:
            UnknownNameError: There is no such option, camera or mode.
            OptionError: A value cannot be.
        """
        known = [field.name for field in fields(Options)]
        for name in options:
            if name not in known:
                raise UnknownNameError("option", name, known)
        return Options(**options)

    @property
    def camera_names(self) -> tuple[str, ...]:
        """The cameras that the observation shows."""
        if isinstance(self.cameras, bool):
            return POLICY_CAMERAS if self.cameras else ()
        return (self.cameras,) if isinstance(self.cameras, str) else tuple(self.cameras)

    @property
    def image_shape(self) -> tuple[int, int]:
        """Height and width of a picture in pixels."""
        size = self.image_size
        return (size, size) if isinstance(size, int) else size


def _is_count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 1


def _check_size(name: str, size: object) -> None:
    native = (NATIVE_HEIGHT, NATIVE_WIDTH)
    if (
        isinstance(size, (tuple, list))
        and len(size) == len(native)
        and all(_is_count(pixels) for pixels in size)
        and all(pixels <= most for pixels, most in zip(size, native, strict=True))
    ):
        return
    raise OptionError(
        f"{name} is (height, width) in pixels, at most {native}"
        f"{', or one number for a square' if name == 'image_size' else ''}; got {size!r}."
    )


def make_env(task: str | Task, **options: Any) -> gym.Env:
    """An environment of a task; without options, that of the evaluation protocol.

    Args:
        task: A task, its id, or its import path "module:ATTRIBUTE".
        options: The fields of `Options`.

    Raises:
        UnknownNameError: There is no such task, option, camera or mode.
        OptionError: A value cannot be.
    """
    chosen = Options.of(options)
    definition = catalog.get(task) if isinstance(task, str) else task
    if chosen.horizon is not None:
        definition = replace(definition, horizon=chosen.horizon)
    env: gym.Env = SimEnv(
        definition, render_mode=chosen.render_mode, render_size=chosen.render_size
    )
    env = TimeLimit(TaskStages(RandomizedReset(env)), definition.horizon)
    env = ACTION_MODES[chosen.action_mode](env)
    if chosen.binary_gripper:
        env = BinaryGripper(env)
    if chosen.chunk is not None:
        env = ActionChunks(env, chosen.chunk)
    if chosen.camera_names:
        env = Cameras(env, chosen.camera_names, chosen.image_shape)
    return env
