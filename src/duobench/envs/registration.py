"""Environments by task, their ids, and their registration. Importing this loads no physics."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec, WrapperSpec

from duobench.errors import DuoBenchError, OptionError
from duobench.tasks import catalog

if TYPE_CHECKING:
    from duobench.tasks.task import Task

NAMESPACE = "duobench"
VERSION = 1
"""Version of the environments' interface; that of the episodes is `randomness.SUITE_VERSION`."""
ENTRY_POINT = "duobench.envs.protocol:make_base"
WRAPPERS = WrapperSpec("protocol", "duobench.envs.protocol:with_wrappers", {})


def env_id(task_id: str) -> str:
    """Gymnasium's id of a task: `duobench/<task>-v1`."""
    return f"{NAMESPACE}/{task_id}-v{VERSION}"


def register_catalog() -> None:
    """Register the tasks of the benchmark with Gymnasium; done once by `import duobench`."""
    for name, horizon in catalog.HORIZONS.items():
        gym.registry.setdefault(env_id(name), _spec_of(name, horizon, {"task": name}))


def register(task: Task | str) -> str:
    """Register a task of one's own, so that `gymnasium.make` finds it in this process.

    Call it at the end of the module that defines the task; then `gymnasium.make("module:ID")` and
    the worker processes of a vector environment find it too.

    Args:
        task: The task, or its import path "module:ATTRIBUTE".

    Returns:
        The id, `duobench/<task>-v1`. Registering it again replaces it.

    Raises:
        DuoBenchError: A task of the benchmark has the same id.
    """
    spec = _spec(task)
    if spec.id in map(env_id, catalog.names()):
        raise DuoBenchError(f"The benchmark has a task with id {spec.id!r}; give yours another id.")
    gym.registry[spec.id] = spec
    return spec.id


def make(task: Task | str, **options: Any) -> gym.Env:
    """An environment; `gymnasium.make("duobench/<task>-v1")` makes the same one.

    Args:
        task: Id of a task or of its environment, import path "module:ATTRIBUTE", or a task.
        options: `cameras` (True, False or names), `image_size` (224, or height and width),
            `object_state` (whether the observation has `environment_state`, privileged),
            `flat_obs` (False, or True for a `Dict` of one level, with `head_image` and so on
            instead of `pixels`, as Stable-Baselines3 and TorchRL take it),
            `action_mode` ("joint", "joint_relative", "cartesian", "cartesian_relative"),
            `binary_gripper`, `chunk` (actions in one step), `horizon`, `split` ("eval", or "train"
            for demonstrations), `look` ("wood_table", "random:7", ...), `render_mode`
            ("rgb_array"), `render_size`; see `duobench.envs.config.EnvConfig`.

    Returns:
        The environment; without options, that of the evaluation protocol.

    Raises:
        UnknownNameError: There is no such task or option; near misses are listed.
        OptionError: What is given is no task, or the value of an option is invalid.
    """
    cameras = options.get("cameras")
    if isinstance(cameras, Iterable) and not isinstance(cameras, str):
        options["cameras"] = tuple(cameras)  # the spec keeps and copies it, so no generator
    if isinstance(task, str) and (known := env_id(catalog.plain(task))) in gym.registry:
        return gym.make(known, **options)
    return gym.make(_spec(task), **options)


def _spec(task: Task | str) -> EnvSpec:
    from duobench.tasks.task import Task

    definition = catalog.get(task)
    if not isinstance(definition, Task):
        raise OptionError(
            'A task is an id, an import path "module:ATTRIBUTE", or a duobench.tasks.Task; '
            f"got {task!r}."
        )
    if isinstance(task, str):
        return _spec_of(definition.id, definition.horizon, {"task": task})

    # A function, because Gymnasium copies keyword arguments deeply and a task must stay one.
    def create(**options: Any) -> gym.Env:
        from duobench.envs.protocol import make_base

        return make_base(task, **options)

    return _spec_of(task.id, task.horizon, {}, create)


def _spec_of(
    task_id: str, horizon: int, kwargs: dict[str, Any], create: Any = ENTRY_POINT
) -> EnvSpec:
    # The wrappers refuse steps out of order, and the tests run Gymnasium's checker on them: wrapped
    # again, tools would not find their attributes.
    return EnvSpec(
        id=env_id(task_id),
        entry_point=create,
        max_episode_steps=horizon,
        order_enforce=False,
        disable_env_checker=True,
        additional_wrappers=(WRAPPERS,),
        kwargs=kwargs,
    )
