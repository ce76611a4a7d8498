"""Environments by task, their ids, and their registration. Importing this loads no physics."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import (
    TYPE_CHECKING,
    Any,
    Literal,
    TypedDict,
    Unpack,
)

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec, WrapperSpec

from duobench.core.errors import DuoBenchError, OptionError
from duobench.core.types import as_count, as_several
from duobench.tasks import catalog
from duobench.world.robot.cameras import Camera

if TYPE_CHECKING:
    from duobench.tasks.shifts.shift import Shift
    from duobench.tasks.task import Task
    from duobench.world.looks.look import Look

NAMESPACE = "duobench"
VERSION = 1
"""Version of the environments' interface; that of the episodes is `randomness.SUITE_VERSION`."""
WARP = "warp"
ENGINES = ("mujoco", WARP)
"""Engines that can step physics; scores are those of the first."""
ENTRY_POINT = "duobench.envs.protocol:make_base"
WRAPPERS = WrapperSpec("protocol", "duobench.envs.protocol:with_wrappers", {})


class EnvOptions(TypedDict, total=False):
    """Options of `EnvConfig.from_options`, which describes each, and Gymnasium's time limit."""

    cameras: bool | str | Camera | Iterable[str | Camera] | Mapping[str, Any]
    image_size: int | Sequence[int]
    image_sizes: Mapping[str, int | Sequence[int]]
    depth: bool | str | Iterable[str]
    segmentation: bool | str | Iterable[str]
    object_state: bool
    flat_obs: bool
    action_mode: str
    binary_gripper: bool
    chunk: int | None
    horizon: int | None
    instructions: str
    reward: str
    split: str
    speed_fraction: float
    gripper: str
    mount: str
    render_mode: str | None
    render_size: int | Sequence[int]
    look: str | Look | Mapping[str, Any]
    shift: str | Shift | Mapping[str, Any]
    max_episode_steps: int


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
        raise DuoBenchError(
            f"The benchmark has a task with id {spec.id!r}; give yours another id."
        )
    gym.registry[spec.id] = spec
    return spec.id


def make(task: Task | str, **options: Unpack[EnvOptions]) -> gym.Env:
    """An environment; `gymnasium.make("duobench/<task>-v1")` makes the same one.

    Args:
        task: Id of a task or of its environment, import path "module:ATTRIBUTE", or a task.
        options: What differs from the evaluation protocol, by name:

            - `cameras` (True): True, False, or several of head, left_wrist, right_wrist and cameras
              of one's own (`duobench.Camera`); or sizes of their images by name.
            - `image_size` (224, 224): height and width of their images, or one number, in pixels.
            - `image_sizes` ({}): sizes by camera of those that have another one.
            - `depth` (False): True, False or names of cameras whose depth observations hold.
            - `segmentation` (False): the same for the parts that pixels show.
            - `object_state` (False): whether observations hold `environment_state`, privileged.
            - `flat_obs` (False): a `Dict` of one level, `head_image` in place of `pixels`, ...
            - `action_mode` ("joint"): or "joint_relative", "cartesian", "cartesian_relative".
            - `binary_gripper` (False): whether openings are rounded to open or closed.
            - `chunk` (None): number of actions in one step, as an array (chunk, n).
            - `horizon` (None): control steps until an episode is truncated; None is the task's.
            - `instructions` ("fixed"): or "varied", one of the task's paraphrases an episode.
            - `reward` ("stage"): stage / last stage in every step, which pays waiting before the
              last stage more than finishing; to train, "progress": what the step adds to it, or
              "dense": to it and to how near the next stage is.
            - `split` ("eval"): layouts; "train" for demonstrations.
            - `speed_fraction` (1.0): part of the joints' speed limits that the arms use.
            - `gripper` (DEFAULT_GRIPPER): one of `GRIPPERS`, on both arms, or "module:ATTRIBUTE".
            - `mount` ("duo"): how the arms are mounted; "wide" has them 200 mm further apart.
            - `render_mode` (None): "rgb_array", for `render`.
            - `render_size` (480, 640): height and width of its image, in pixels.
            - `look` ("default"): how images look; `duobench.world.looks.names()` lists them.
            - `shift` ("none"): what is harder than usual, such as "look-3".
            - `max_episode_steps` (None): Gymnasium's name of `horizon`; -1 for none.

    Returns:
        The environment; `env.config` has the chosen values, `env.unwrapped` is the simulator alone.

    Raises:
        UnknownNameError: There is no such task or option; near misses are listed.
        OptionError: What is given is no task, or the value of an option is invalid.
    """
    return gym.make(_spec_with(task, options), **options)


def make_vec(
    task: Task | str,
    num_envs: int = 1,
    vectorization_mode: Literal["sync", "async"] | None = None,
    vector_kwargs: dict[str, Any] | None = None,
    *,
    threads: int | None = None,
    engine: Literal["mujoco", "warp"] = "mujoco",
    layouts: int | None = None,
    **options: Unpack[EnvOptions],
) -> gym.vector.VectorEnv:
    """Several environments of a task side by side, the fastest way that their options allow.

    Usually all episodes are stepped in this process on MuJoCo's own threads, one for each core that
    this process may use; see `duobench.envs.BatchEnv`. Where options need environments of their own
    (shifts of physics or sensing, `vector_kwargs` but `autoreset_mode`), they are as
    `gymnasium.make_vec` makes them, one after the other. What you choose by `threads` or
    `vectorization_mode` is what you get, or an error. Episodes are the same to the last bit.

    With the engine "warp", MuJoCo Warp steps them on a graphics card: near the same, and no scores.

    Args:
        task: As for `make`.
        num_envs: How many.
        vectorization_mode: Each an environment of its own: "sync" steps one after the other,
            "async" in processes of their own.
        vector_kwargs: Arguments of Gymnasium's vector environment, such as `context`; where images
            were rendered before, processes begin anew with {"context": "spawn"}.
        threads: Threads of the processor that physics runs on; where it is given, there are no
            images unless `cameras` asks for them.
        engine: "warp" in place of threads, with the extra `warp`.
        layouts: With threads or Warp, how many layouts episodes without a seed are taken from: the
            seeds' from 0 on, each settled once. None takes a new one for each episode.
        options: As for `make`. Errors are the same.
    """
    _check_counts(num_envs, threads, layouts)
    if engine not in ENGINES or (engine == WARP and threads is not None):
        raise OptionError(
            f"engine is one of {', '.join(ENGINES)}, and {WARP} takes no threads; got {engine!r}."
        )
    is_chosen = threads is not None or engine == WARP
    needs_own = vectorization_mode is not None or bool(
        (vector_kwargs or {}).keys() - {"autoreset_mode"}
    )
    if is_chosen and needs_own:
        raise OptionError(
            "With threads or Warp, leave vectorization_mode out, and vector_kwargs but "
            "autoreset_mode."
        )
    if is_chosen:
        options.setdefault("cameras", False)
    spec = _spec_with(task, options)
    if not needs_own:
        from duobench.world.sim.opengl import load_engine

        load_engine()
        from duobench.envs.batch_env import BatchEnv, takes

        env = gym.make(spec, **options)
        if is_chosen or takes(env):
            if not is_chosen:
                threads = min(num_envs, _cores())
            return BatchEnv(env, num_envs, threads, layouts, **(vector_kwargs or {}))
        env.close()
    if layouts is not None:
        raise OptionError(
            "layouts belongs to threads and Warp, which take no vectorization_mode and no shift of "
            "physics or sensing; leave it out."
        )
    mode = vectorization_mode or "sync"
    return gym.make_vec(spec, num_envs, mode, vector_kwargs, **options)


def _check_counts(num_envs: int, threads: int | None, layouts: int | None) -> None:
    if as_count(num_envs) is None:
        raise OptionError(f"num_envs is a whole number from 1 on, got {num_envs!r}.")
    for name, value in (("threads", threads), ("layouts", layouts)):
        if value is not None and as_count(value) is None:
            raise OptionError(f"{name} is a whole number from 1 on, got {value!r}.")


def _cores() -> int:
    """Count the processor's cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _spec_with(task: Task | str, options: EnvOptions) -> EnvSpec | str:
    """Specification of a task's environment for Gymnasium, of options that it may copy."""
    # The spec keeps these and writes them as JSON: no generators, and cameras as plain data.
    given: dict[str, Any] = dict(options)
    for name in ("depth", "segmentation"):
        several = as_several(given.get(name))
        if several is not None:
            given[name] = several
    cameras = given.get("cameras")
    several = (cameras,) if isinstance(cameras, Camera) else as_several(cameras)
    if several is not None:
        given["cameras"] = tuple(
            asdict(each) if isinstance(each, Camera) else each for each in several
        )
    options.update(given)  # type: ignore[typeddict-item] - plain data is taken too
    if isinstance(task, str) and (known := env_id(catalog.plain(task))) in gym.registry:
        return known
    return _spec(task)


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
