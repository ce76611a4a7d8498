"""Episodes as vla-eval plays them, and the parameters of its own DuoBench; without vla-eval.

They are the episodes of the evaluation: the same seeds, horizons, stages and success.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from duobench.core.errors import OptionError
from duobench.core.randomness import episode_seed
from duobench.core.types import HEAD
from duobench.envs.config import EnvConfig
from duobench.envs.duo_env import ResetNeededError
from duobench.envs.execution import Step, execute, optional_method
from duobench.envs.registration import make
from duobench.policy.batch import Observation
from duobench.policy.policy import dimensions
from duobench.policy.serving.message_format import MessageFormat, read_format
from duobench.policy.serving.vla_eval import MODES
from duobench.results.run import needed_options
from duobench.tasks import catalog

Size = Sequence[int] | int
Resolution = Mapping[str, Size] | Size


class Episodes:
    """Plays episodes one after the other, in an environment that fits a format.

    Args:
        message_format: What is shown, and what actions mean.
        options: Of the environments, beside what follows from the format; see
            `duobench.envs.config.EnvConfig`.
    """

    def __init__(self, message_format: MessageFormat, **options: Any) -> None:
        metadata = message_format.metadata("", "")
        self._options = {**needed_options(metadata), **options}
        EnvConfig.from_options(self._options)
        self.message_format = message_format
        """What is shown, and what actions mean."""
        self._import_path: str | None = None
        self._env: gym.Env | None = None
        self._instruction = ""
        self._last: Step | None = None

    def begin(self, task: str, index: int) -> Step:
        """Begin an episode of a task, named by its id or import path, as the evaluation has it."""
        if task != self._import_path:
            self.close()
        if self._env is None:
            self._env, self._import_path = make(task, **self._options), task
        optional_method(self._env, "set_rendering")(True)
        observation, info = self._env.reset(seed=episode_seed(catalog.get(task).id, index))
        self._instruction = info["instruction"]
        self._last = Step(
            number=0,
            action=np.empty(0),
            observation=observation,
            reward=0.0,
            terminated=False,
            truncated=False,
            info=info,
        )
        return self._last

    def execute(self, actions: ArrayLike) -> Step:
        """Execute an action (n,) or a chunk (H, n), until its end or the episode's.

        The last step has no images if the episode ended before the chunk did. After a `PolicyError`
        about what is no chunk of finite numbers, the episode goes on.
        """
        if self._env is None or self._last is None:
            raise ResetNeededError("No episode is running; begin one first.")
        chunk = self.message_format.chunk([actions] if dimensions(actions) == 1 else actions)
        before, render_last = self._last.number, bool(self.message_format.images)
        try:
            *_, self._last = execute(self._env, chunk, before=before, render_last=render_last)
        except BaseException:
            self.close()  # it may be in any state now
            raise
        return self._last

    def request(self, observation: Observation) -> dict[str, Any]:
        """An observation of the running episode as the format says."""
        return self.message_format.request(observation, self._instruction)

    def hold_action(self, last: ArrayLike | None) -> NDArray[np.float32]:
        """An action (n,) that keeps the arms where the last action or chunk has sent them.

        Where there was none, they stay where they are measured.
        """
        sizes = self.message_format.action_sizes
        if last is not None:
            action = np.atleast_2d(np.asarray(last, dtype=np.float32))[-1].copy()
        elif self._last is None:
            action = np.zeros(sum(sizes.values()), np.float32)
        else:
            action = self.message_format.measured_action(self._last.observation)
        if self.message_format.actions.mode.endswith("relative"):
            is_arm = np.repeat([not part.endswith("gripper") for part in sizes], [*sizes.values()])
            action[is_arm] = 0.0
        return action

    def close(self) -> None:
        """Free the environment."""
        if self._env is not None:
            self._env.close()
        self._env = self._import_path = self._last = None


def format_for(
    name: str,
    *,
    control_mode: str | None,
    relative_to: str | None,
    send_state: bool,
    send_wrist_image: bool,
    camera_resolution: Resolution | None,
) -> MessageFormat:
    """A format of a name or a file, with what parameters of `vla_eval.DuoBench` change about it."""
    message_format = read_format(name)
    mode = _mode(message_format.actions.mode, control_mode, relative_to)
    shown = message_format.images.items()
    return replace(
        message_format,
        images={key: name for key, name in shown if send_wrist_image or name == HEAD},
        image_size=_size(camera_resolution, message_format),
        state=message_format.state if send_state else {},
        actions=replace(message_format.actions, mode=mode),
    )


def tasks_by_id(import_paths: Sequence[str] | None) -> dict[str, str]:
    """Import paths of tasks by their ids: all of the benchmark if there are none."""
    given = [import_paths] if isinstance(import_paths, str) else import_paths
    paths: dict[str, str] = {}
    for path in given or catalog.names():
        task_id = catalog.get(path).id
        if task_id in paths:
            raise OptionError(f"Task {task_id!r} is named twice in task_ids. Name each task once.")
        paths[task_id] = path
    return paths


def _mode(usual: str, control_mode: str | None, relative_to: str | None) -> str:
    control, relative = next((key for key, mode in MODES.items() if mode == usual), (usual, "none"))
    mode = str(control_mode or control).lower(), str(relative_to or relative).lower()
    if mode in MODES:
        return MODES[mode]
    known = " or ".join(f"{theirs} with {frame}" for theirs, frame in MODES)
    raise OptionError(
        f"There are no actions with control_mode {mode[0]!r} and relative_to {mode[1]!r}. There "
        f"are {known}: poses are x y z qx qy qz qw, displacements of the tool a translation and a "
        "rotation vector along the axes of the table frame."
    )


def _size(resolution: Resolution | None, message_format: MessageFormat) -> tuple[int, int]:
    if resolution is None:
        return message_format.image_size
    if not isinstance(resolution, Mapping):
        return _checked(resolution)
    EnvConfig.from_options({"cameras": resolution.keys()})
    sizes = {_checked(size) for size in resolution.values()}
    if not set(message_format.images.values()) <= resolution.keys():
        sizes.add(message_format.image_size)
    if len(sizes) > 1:
        raise OptionError(
            "All images have one size here: give camera_resolution as [height, width], or with the "
            f"same size for each camera; got {resolution!r}."
        )
    return sizes.pop() if sizes else message_format.image_size


def _checked(size: object) -> tuple[int, int]:
    return EnvConfig.from_options({"image_size": size}).image_size
