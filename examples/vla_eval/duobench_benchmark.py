"""DuoBench as a benchmark of vla-eval 0.8: `benchmark: duobench_benchmark:DuoBench`.

It plays the episodes of `duobench eval`, so that the same actions score the same.
"""

import ctypes.util
import os
from collections.abc import Sequence
from typing import Any, ClassVar

from duobench_episodes import (  # pyright: ignore[reportMissingImports]
    Episodes,
    Resolution,
    format_for,
    tasks_by_id,
)
from vla_eval.benchmarks.base import (  # pyright: ignore[reportMissingImports]
    StepBenchmark,
    StepResult,
)
from vla_eval.recording import NullEpisodeRecorder  # pyright: ignore[reportMissingImports]
from vla_eval.specs import DimSpec  # pyright: ignore[reportMissingImports]

from duobench.core.errors import OptionError, PolicyError, check_known
from duobench.evaluation import Step
from duobench.policy.serving.vla_eval import action_spec, observation_spec
from duobench.tasks import catalog
from duobench.world.robot.gripper import DEFAULT_GRIPPER


class DuoBench(StepBenchmark):
    """The tasks of DuoBench, with actions and observations as a format says.

    The parameters, from `task_ids` to `gripper`, are those of the table of the page serving;
    vla-eval's episode i is episode `seed + i` of `duobench eval`.
    """

    _ALL_RECORD_FIELDS: ClassVar = frozenset(
        {"reward", "done", "success", "stage", "steps"}
    )
    render_backends: ClassVar = frozenset({"gpu", "cpu"})

    def __init__(  # noqa: PLR0913 - each is a parameter of their configuration
        self,
        *,
        task_ids: Sequence[str] | None = None,
        seed: int = 0,
        max_steps: int | None = None,
        send_state: bool = True,
        send_wrist_image: bool = True,
        camera_resolution: Resolution | None = None,
        control_mode: str | None = None,
        relative_to: str | None = None,
        binary_gripper: bool = False,
        format: str = "vla_eval",
        look: str = "default",
        gripper: str = DEFAULT_GRIPPER,
    ) -> None:
        super().__init__()
        if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
            raise OptionError(
                f"seed is the index of an episode, counted from 0; got {seed!r}."
            )
        self._tasks = tasks_by_id(task_ids)
        self._first_episode = seed
        self._max_steps = max_steps
        self._recorder = NullEpisodeRecorder()
        self._format = format_for(
            format,
            control_mode=control_mode,
            relative_to=relative_to,
            send_state=send_state,
            send_wrist_image=send_wrist_image,
            camera_resolution=camera_resolution,
        )
        self._episodes = Episodes(
            self._format,
            horizon=max_steps,
            binary_gripper=binary_gripper,
            look=look,
            gripper=gripper,
        )

    @classmethod
    def configure_render(cls, mode: str) -> dict[str, str]:
        """Choose what renders: the best that works, or with "cpu" by the variables returned."""
        if mode == "gpu":
            return {}
        chosen = {"LIBGL_ALWAYS_SOFTWARE": "1"}
        if ctypes.util.find_library("OSMesa"):
            chosen |= {"MUJOCO_GL": "osmesa", "PYOPENGL_PLATFORM": "osmesa"}
        os.environ.update(chosen)
        return chosen

    def get_tasks(self) -> list[dict[str, Any]]:
        """The tasks, by name and `task_id`."""
        return [{"name": task_id, "task_id": task_id} for task_id in self._tasks]

    def reset(self, task: dict[str, Any]) -> Step:
        """Begin the episode `episode_idx` of a task, counted from the first one."""
        task_id, index = task["task_id"], self._first_episode + int(task["episode_idx"])
        check_known("task", task_id, self._tasks)
        last = self._episodes.begin(self._tasks[task_id], index)
        self._record_image(last)
        return last

    def step(self, action: dict[str, Any]) -> StepResult:
        """Execute an action (n,) or a chunk (H, n), until its end or the episode's."""
        key = self._format.actions.key
        if key not in action:
            raise PolicyError(
                f"The model server answers without {key!r}; it gives "
                f"{', '.join(sorted(map(str, action))) or 'nothing'}."
            )
        last = self._episodes.execute(action[key])
        self._record_image(last)
        self._recorder.record_step(
            reward=last.reward,
            done=last.is_last,
            success=last.info["success"],
            stage=last.info["stage"],
            steps=last.number,
        )
        return StepResult(obs=last, reward=last.reward, done=last.is_last, info={})

    def make_obs(self, raw_obs: Step, task: dict[str, Any]) -> dict[str, Any]:  # noqa: ARG002 - their signature
        """Return the request to the model server."""
        return self._episodes.request(raw_obs.observation)

    def get_step_result(self, step_result: StepResult) -> dict[str, Any]:
        """How the episode has gone so far: `success`, `progress` 0..1 and the highest `stage`."""
        info = step_result.obs.info
        progress = info["stage"] / info["max_stage"]
        return {
            "success": info["success"],
            "progress": progress,
            "stage": info["stage"],
        }

    def get_metric_keys(self) -> dict[str, str]:
        """Success and progress are averaged; a stage means something for one task only."""
        return {"success": "mean", "progress": "mean"}

    def get_action_spec(self) -> dict[str, DimSpec]:
        """The components of an action, in their order."""
        return _specs(action_spec(self._format))

    def get_observation_spec(self) -> dict[str, DimSpec]:
        """The components of an observation."""
        return _specs(observation_spec(self._format))

    def get_metadata(self) -> dict[str, Any]:
        """Most calls of an episode, for a server that gives one action a call; and their size."""
        longest = self._max_steps or max(
            catalog.get(name).horizon for name in self._tasks.values()
        )
        return {
            "max_steps": longest,
            "action_dim": sum(self._format.action_sizes.values()),
        }

    def get_hold_action(self, last_action: dict[str, Any] | None) -> dict[str, Any]:
        """An action that keeps the arms where they were sent, for real time."""
        key = self._format.actions.key
        last = None if last_action is None else last_action.get(key)
        return {key: self._episodes.hold_action(last)}

    def cleanup(self) -> None:
        """Free the environment."""
        self._episodes.close()

    def _record_image(self, last: Step) -> None:
        """Add an image to their video, if one is shown: one a call, from the first camera."""
        pixels = last.observation.get("pixels", {})
        self._recorder.record_video(next(iter(pixels.values()), None))


def _specs(specs: dict[str, dict[str, Any]]) -> dict[str, DimSpec]:
    return {name: DimSpec.from_dict(spec) for name, spec in specs.items()}
