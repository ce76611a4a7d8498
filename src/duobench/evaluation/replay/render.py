"""Videos and replays in 3D of episodes that are finished: their targets are played again."""

from collections import Counter
from collections.abc import (
    Callable,
    Container,
    Iterable,
    Sequence,
)
from contextlib import closing
from dataclasses import dataclass
from itertools import compress
from operator import not_

from duobench.core.errors import (
    ActionError,
    BackendError,
    EvaluationError,
    UnknownNameError,
    VideoError,
    check_known,
)
from duobench.core.files import write
from duobench.core.randomness import SUITE_VERSION
from duobench.evaluation.episode import Latest
from duobench.evaluation.replay.player import RecordPlayer, why_not
from duobench.evaluation.replay.trajectory import SceneCache, TrajectoryRecorder
from duobench.evaluation.replay.verification import disagreements
from duobench.evaluation.rollouts import Watcher
from duobench.evaluation.video import (
    FRAME_EVERY,
    Overview,
    Picture,
    VideoRecorder,
)
from duobench.results.folder import RunFolder
from duobench.results.records import Key, Record
from duobench.results.run import Run
from duobench.world.looks.catalog import as_look

VIDEO, REPLAY = "video", "replay"
FAILURES, ALL = "failures", "all"
"""Words that choose episodes: those without success, and every one."""
MOST_REPLAYS = 20
"""Replays that a word such as "failures" chooses at most: they make a page of about 2 MB."""
Progress = Callable[[int, int], None]
"""Called with how many of how many are there: before the first one is made, then after each."""
_OF_AN_EPISODE = (
    EvaluationError,
    ActionError,
    BackendError,
    UnknownNameError,
    VideoError,
)
"""Errors after which the other episodes are still possible."""


def choose(
    run: Run,
    records: Iterable[Record],
    words: Sequence[str],
) -> list[Record]:
    """The finished episodes that words choose, in the order of the run.

    Words are "failures", "all" or "TASK:EPISODE", such as "bin_sort:3", under all conditions;
    several add up.
    """
    finished = {record.key: record for record in records}
    chosen: set[Key] = set()
    for word in words:
        if word in {FAILURES, ALL}:
            chosen |= {
                key for key, each in finished.items() if word == ALL or not each.success
            }
        else:
            place = _place(run, {(key.task, key.episode) for key in finished}, word)
            chosen |= {key for key in finished if (key.task, key.episode) == place}
    return [record for key, record in finished.items() if key in chosen]


def _place(
    run: Run, finished: Container[tuple[str, int]], word: str
) -> tuple[str, int]:
    """Task and index that "TASK:EPISODE" stands for."""
    name, colon, index = word.rpartition(":")
    if not (colon and index.isascii() and index.isdecimal()):
        raise EvaluationError(
            f"Videos are made of {FAILURES!r}, {ALL!r} or TASK:EPISODE such as "
            f"{run.suite.tasks[0].id}:{run.suite.first_episode}; got {word!r}."
        )
    check_known("task of this run", name, [task.id for task in run.suite.tasks])
    if (name, int(index)) not in finished:
        raise EvaluationError(
            f"Episode {index} of {name} is not finished: it has no record."
        )
    return name, int(index)


def choose_few(
    run: Run, records: Sequence[Record], words: Sequence[str]
) -> list[Record]:
    """Choose records as `choose`, but with "failures" and "all" only a few of every kind.

    The first episode of each task, condition and last stage comes first, then the second, until
    there are `MOST_REPLAYS`.
    """
    several = {FAILURES, ALL}
    named = choose(run, records, [word for word in words if word not in several])
    seen: Counter[tuple[str, str, int]] = Counter()
    ranked: list[tuple[int, Record]] = []
    for record in choose(run, records, [word for word in words if word in several]):
        kind = (record.task, record.condition.name, record.final_stage)
        ranked.append((seen[kind], record))
        seen[kind] += 1
    few = [record for _, record in sorted(ranked, key=lambda one: one[0])][
        :MOST_REPLAYS
    ]
    return [record for record in records if record in named or record in few]


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderResult:
    """Chosen episodes, by what became of them."""

    made: tuple[Record, ...]
    """Episodes of which something was made now."""
    there: tuple[Record, ...]
    """Episodes of which it was there already; it stays."""
    impossible: tuple[tuple[Record, str], ...]
    """Episodes of which it cannot be made, and why."""


def make_missing(
    folder: RunFolder,
    run: Run,
    records: Sequence[Record],
    what: str,
    *,
    import_tasks: bool = False,
    video_look: str | None = None,
    progress: Progress = lambda _done, _total: None,
) -> RenderResult:
    """Make the missing videos or replays of episodes of a run, where its report looks for them.

    A video shows what a video of the evaluation itself shows: the table with stage and time, and
    beside it the images that the policy saw. Where the length of its chunks is not known, and so
    not when it looked, the images are those of the moment. Nothing is rendered for replays, and
    those of another suite are impossible.

    Args:
        folder: The folder of the run.
        run: The run.
        records: Of which episodes.
        what: `VIDEO` or `REPLAY`.
        import_tasks: Whether to import tasks that are not of the benchmark, which runs the code of
            the modules that the run names. Their episodes have no video without.
        video_look: Look of the table in videos; None is that of the run.
        progress: Told about the progress.
    """
    if what == VIDEO and run.suite.version != SUITE_VERSION:
        raise EvaluationError(
            f"The run is of suite {run.suite.version}; this version plays suite {SUITE_VERSION}, "
            "in which what was sent leads elsewhere. Make videos with the version that played it."
        )
    made_by = _RecordRenderer(
        folder, run, import_tasks=import_tasks, video_look=video_look
    )
    with closing(made_by) as renderer:
        make = renderer.make_video if what == VIDEO else renderer.make_replay
        is_there = [
            folder.video(each.key).exists()
            if what == VIDEO
            else folder.replay(each.key) is not None
            for each in records
        ]
        return renderer.make_missing(records, is_there, make, progress)


class _RecordRenderer:
    """Makes videos and replays of episodes of a run, in its folder; see `RecordPlayer`."""

    def __init__(
        self,
        folder: RunFolder,
        run: Run,
        *,
        import_tasks: bool,
        video_look: str | None,
    ) -> None:
        self._folder, self._run = folder, run
        self._video_look = video_look
        self._player = RecordPlayer(run, import_tasks=import_tasks)
        chunk, execution = run.candidate.metadata.horizon, run.suite.execution
        self._chunk = chunk and min(chunk, execution.execute or chunk)
        self._overview: Latest[Overview] = Latest()
        self._scenes = SceneCache()

    def make_missing(
        self,
        records: Sequence[Record],
        is_there: Sequence[bool],
        make: Callable[[Record], None],
        progress: Progress,
    ) -> RenderResult:
        there = tuple(compress(records, is_there))
        missing = compress(records, map(not_, is_there))
        places = {task.id: place for place, task in enumerate(self._run.suite.tasks)}
        made: list[Record] = []
        impossible: list[tuple[Record, str]] = []
        progress(len(there), len(records))
        for record in sorted(missing, key=lambda record: places[record.task]):
            try:
                reason = why_not(record)
                if reason:
                    raise EvaluationError(reason)
                make(record)
                made.append(record)
            except _OF_AN_EPISODE as error:
                impossible.append((record, str(error)))
            progress(len(there) + len(made) + len(impossible), len(records))
        return RenderResult(made=tuple(made), there=there, impossible=tuple(impossible))

    def make_video(self, record: Record) -> None:
        env = self._player.environment_of(record, has_images=True)
        overview = self._overview.get(env, lambda: Overview(env, self._video_look))
        picture = Picture(self._player.task(record), is_seen=self._chunk is not None)
        recorder = VideoRecorder(overview.image, picture)
        self._replay(record, recorder, has_images=True)
        video = recorder.video()
        if video:
            write(self._folder.video(record.key), video)

    def make_replay(self, record: Record) -> None:
        recorder = TrajectoryRecorder(self._scenes, as_look(record.config.look))
        self._replay(record, recorder)
        found = recorder.trajectory()
        write(self._folder.scene(found.scene), found.scene_data)
        write(self._folder.new_replay(record.key, found.scene), found.track)

    def _replay(
        self, record: Record, watcher: Watcher, *, has_images: bool = False
    ) -> None:
        chunk = (self._chunk or FRAME_EVERY) if has_images else None
        replay = self._player.replay(
            record, [watcher], has_images=has_images, chunk=chunk
        )
        found = disagreements(record, replay)
        if found:
            raise EvaluationError(
                f"Played again here it comes out differently: {found[0]}."
            )

    def close(self) -> None:
        self._overview.close()
        self._player.close()
