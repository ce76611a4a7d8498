"""Videos of episodes that are finished: what was sent is played again, in front of the cameras."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, replace

import gymnasium as gym

from duobench.envs.config import EnvConfig
from duobench.envs.execution import Step, execute
from duobench.envs.protocol import make_env
from duobench.errors import (
    ActionError,
    BackendError,
    EvaluationError,
    RenderingError,
    VideoError,
    check_known,
)
from duobench.evaluation.overview import Overview
from duobench.evaluation.picture import Picture
from duobench.evaluation.recorder import FRAME_EVERY, VideoRecorder
from duobench.files import write
from duobench.randomness import SUITE_VERSION
from duobench.replay.missing import Made, make_missing
from duobench.replay.recordings import command_config
from duobench.results.folder import RunFolder
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import TaskInfo
from duobench.tasks import catalog
from duobench.types import Array

FAILURES, ALL = "failures", "all"
"""Words that choose episodes: those without success, and every one."""


def choose(run: Run, records: Iterable[EpisodeRecord], words: Sequence[str]) -> list[EpisodeRecord]:
    """The finished episodes that words choose, in the order of the run.

    Args:
        run: The run.
        records: Its records.
        words: "failures", "all" or "TASK:EPISODE", such as "bin_sort:3"; several add up.

    Raises:
        EvaluationError: A word is none of these, or names an episode that is not finished.
        UnknownNameError: A word names a task that is not in the run.
    """
    by_place = {(record.task, record.episode): record for record in records}
    chosen: set[tuple[str, int]] = set()
    for word in words:
        if word in {FAILURES, ALL}:
            chosen |= {place for place, each in by_place.items() if word == ALL or not each.success}
        else:
            chosen.add(_place(run, by_place, word))
    return [record for place, record in by_place.items() if place in chosen]


def _place(run: Run, finished: Iterable[tuple[str, int]], word: str) -> tuple[str, int]:
    """Task and index that "TASK:EPISODE" stands for."""
    name, colon, index = word.rpartition(":")
    if not (colon and index.isascii() and index.isdecimal()):
        raise EvaluationError(
            f"Videos are made of {FAILURES!r}, {ALL!r} or TASK:EPISODE such as "
            f"{run.suite.tasks[0].id}:{run.suite.first_episode}; got {word!r}."
        )
    check_known("task of this run", name, [task.id for task in run.suite.tasks])
    if (name, int(index)) not in finished:
        raise EvaluationError(f"Episode {index} of {name} is not finished: it has no record.")
    return name, int(index)


def make_videos(
    folder: RunFolder,
    run: Run,
    records: Sequence[EpisodeRecord],
    *,
    import_tasks: bool = False,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> Made:
    """Make the missing videos of episodes of a run, where its report looks for them.

    A video shows what a video of the evaluation itself shows: the table with stage and time, and
    beside it the images that the policy saw. Where the length of its chunks is not known, and so
    not when it looked, the images are those of the moment.

    Args:
        folder: The folder of the run.
        run: The run.
        records: Of which episodes.
        import_tasks: Whether to import tasks that are not of the benchmark, which runs the code of
            the modules that the run names. Their episodes have no video without.
        progress: Called with how many of how many videos are there: once before the first one is
            made, then after each.

    Raises:
        EvaluationError: The run is of another suite version.
        RenderingError: Nothing can be rendered.
        OutputError: A video cannot be written.
        DuoBenchError: A task of the run cannot be found, or its environment cannot be made.
    """
    if run.suite.version != SUITE_VERSION:
        raise EvaluationError(
            f"The run is of suite {run.suite.version}; this version plays suite {SUITE_VERSION}, "
            "in which what was sent leads elsewhere. Make videos with the version that played it."
        )
    return make_missing(
        run,
        records,
        lambda task: Replay(folder, run, task, import_tasks=import_tasks),
        is_there=lambda record: folder.video(record.task, record.episode).exists(),
        excuses=(VideoError,),
        progress=progress,
    )


class Replay:
    """Plays finished episodes of one task again; the environment is made once."""

    def __init__(
        self, folder: RunFolder, run: Run, task: TaskInfo, *, import_tasks: bool = False
    ) -> None:
        """Remember what to play.

        Args:
            folder: The folder of the run.
            run: The run, which says how often the policy looks.
            task: Its task.
            import_tasks: Whether to import the task if it is not of the benchmark.
        """
        self._folder, self._task = folder, task
        is_known = task.id in catalog.names()
        self._reference = task.id if is_known else task.reference if import_tasks else None
        self._chunk = run.metadata.horizon
        if self._chunk is not None:
            self._chunk = min(self._chunk, run.suite.execution.execute or self._chunk)
        self._env: gym.Env | None = None
        self._overview: Overview | None = None
        self._config: EnvConfig | None = None

    def make(self, record: EpisodeRecord) -> None:
        """Make the video of an episode, where the report looks for it.

        Raises:
            OutputError: It cannot be written.
            VideoError: As `video`.
            RenderingError: Nothing can be rendered.
            DuoBenchError: The environment cannot be made.
        """
        write(self._folder.video(record.task, record.episode), self.video(record))

    def video(self, record: EpisodeRecord) -> bytes:
        """The video of an episode, as a WebM file.

        Raises:
            VideoError: What was sent is not known, or leads to other stages here; or the task is
                not to be imported.
            RenderingError: Nothing can be rendered.
            DuoBenchError: The environment cannot be made.
        """
        env, overview = self._prepare(record.config)
        recorder = VideoRecorder(
            overview.image, Picture(self._task, is_seen=self._chunk is not None)
        )
        try:
            reached = self._play(env, record, recorder)
        except RenderingError:
            raise
        except (EvaluationError, ActionError, BackendError) as error:
            raise VideoError(f"What was sent cannot be played: {error}") from error
        finally:
            recorder.on_episode_end(None)
        video = recorder.video()
        if reached != record.stage_changes or video is None:
            raise VideoError(
                "What was sent leads to other stages here than its record says, as it may with "
                "other versions of MuJoCo or NumPy, or on another kind of processor."
            )
        return video

    def close(self) -> None:
        """Free environment and renderer."""
        if self._overview is not None:
            self._overview.close()
        if self._env is not None:
            self._env.close()
        self._env = self._overview = None

    def _play(
        self, env: gym.Env, record: EpisodeRecord, recorder: VideoRecorder
    ) -> tuple[tuple[int, int], ...]:
        """Show an episode, and return when which stage was reached."""
        targets = record.targets()
        if targets is None:
            raise VideoError("Its record does not have what was sent.")
        observation, info = env.reset(seed=record.seed)
        recorder.on_episode_start(env, observation, info)
        reached = [(0, info["stage"])] if info["stage"] else []
        for step in _steps(env, targets, self._chunk or FRAME_EVERY):
            recorder.on_step(step)
            if (stage := step.info["stage"]) > (reached[-1][1] if reached else 0):
                reached.append((step.number, stage))
        return tuple(reached)

    def _prepare(self, config: EnvConfig) -> tuple[gym.Env, Overview]:
        """An environment with the images of the policy, and with what was sent as its actions."""
        if self._reference is None:
            raise VideoError(f"The task {self._task.reference!r} is none of the benchmark.")
        config = replace(command_config(config), cameras=config.cameras, look=config.look)
        if self._env is None or self._overview is None or self._config != config:
            self.close()
            self._env = make_env(self._reference, **asdict(config))
            self._overview = Overview(self._env)
            self._config = config
        return self._env, self._overview


def _steps(env: gym.Env, targets: Array, chunk: int) -> Iterator[Step]:
    """Every control step; images are rendered after each chunk, for whoever acts then."""
    for start in range(0, len(targets), chunk):
        for step in execute(env, targets[start : start + chunk], before=start, render_last=True):
            yield step
            if step.is_last:
                return
