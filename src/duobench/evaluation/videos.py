"""Videos of episodes that are finished: what was sent is played again, in front of the cameras."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass

import gymnasium as gym

from duobench.errors import EvaluationError, VideoError, check_known
from duobench.evaluation.overview import Overview
from duobench.evaluation.picture import Picture
from duobench.evaluation.recorder import FRAME_EVERY, VideoRecorder
from duobench.evaluation.sent import SentPlayer, check_suite
from duobench.files import write
from duobench.results.folder import RunFolder
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import TaskInfo

FAILURES, ALL = "failures", "all"
"""Words that choose episodes: those without success, and every one."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Videos:
    """What became of the videos of chosen episodes."""

    made: tuple[EpisodeRecord, ...]
    """Episodes whose video was made now."""
    there: tuple[EpisodeRecord, ...]
    """Episodes whose video was there already, which stays."""
    impossible: tuple[tuple[EpisodeRecord, str], ...]
    """Episodes that have no video, and why."""


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
) -> Videos:
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
    check_suite(run)
    there, missing = [], []
    for record in records:
        exists = folder.video(record.task, record.episode).exists()
        (there if exists else missing).append(record)
    made: list[EpisodeRecord] = []
    impossible: list[tuple[EpisodeRecord, str]] = []
    progress(len(there), len(records))
    for task in run.suite.tasks:
        with closing(_Camera(run, task, import_tasks=import_tasks)) as camera:
            for record in missing:
                if record.task != task.id:
                    continue
                try:
                    write(folder.video(task.id, record.episode), camera.video(record))
                    made.append(record)
                except (VideoError, EvaluationError) as error:
                    impossible.append((record, str(error)))
                progress(len(there) + len(made) + len(impossible), len(records))
    return Videos(made=tuple(made), there=tuple(there), impossible=tuple(impossible))


class _Camera:
    """Films finished episodes of one task; the environment is made once."""

    def __init__(self, run: Run, task: TaskInfo, *, import_tasks: bool) -> None:
        self._task = task
        self._chunk = run.metadata.horizon
        self._player = SentPlayer(
            task, look_every=self._chunk or FRAME_EVERY, import_tasks=import_tasks
        )
        self._filmed: gym.Env | None = None
        self._overview: Overview | None = None

    def video(self, record: EpisodeRecord) -> bytes:
        """The video of an episode, as a WebM file.

        Raises:
            EvaluationError: What was sent cannot be played, or leads elsewhere.
            VideoError: There is not one frame.
            RenderingError: Nothing can be rendered.
            DuoBenchError: The environment cannot be made.
        """
        overview = self._overview_of(self._player.environment(record))
        picture = Picture(self._task, is_seen=self._chunk is not None)
        recorder = VideoRecorder(overview.image, picture)
        self._player.play(record, recorder)
        video = recorder.video()
        if video is None:
            raise VideoError("Nothing was filmed.")
        return video

    def close(self) -> None:
        """Free environment and renderer."""
        if self._overview is not None:
            self._overview.close()
        self._player.close()

    def _overview_of(self, env: gym.Env) -> Overview:
        if self._overview is None or self._filmed is not env:
            if self._overview is not None:
                self._overview.close()
            self._overview, self._filmed = Overview(env), env
        return self._overview
