"""Replays of finished episodes in 3D: the tracks of their bodies, for the page of a report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

from duobench.errors import ActionError, BackendError, EvaluationError, UnknownNameError
from duobench.files import write
from duobench.looks.catalog import as_look
from duobench.replay.claims import disagreements
from duobench.replay.missing import Made, make_missing
from duobench.replay.playback import PoseCollector, SceneCache
from duobench.replay.player import TargetPlayer, actual_task, obstacle
from duobench.replay.videos import ALL, FAILURES, choose
from duobench.results.folder import RunFolder
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import TaskInfo
from duobench.web.geometry import Geometry

MOST = 20
"""Replays that a word such as "failures" chooses at most: they make a page of about 2 MB."""


def choose_few(
    run: Run, records: Sequence[EpisodeRecord], words: Sequence[str]
) -> list[EpisodeRecord]:
    """As `videos.choose`, but "failures" and "all" choose few of many, of all kinds.

    The first episode of each task and last stage comes first, then the second, until there are
    `MOST`.

    Raises:
        EvaluationError: A word is none of these, or names an episode that is not finished.
        UnknownNameError: A word names a task that is not in the run.
    """
    several = {FAILURES, ALL}
    named = choose(run, records, [word for word in words if word not in several])
    seen: Counter[tuple[str, int]] = Counter()
    ranked: list[tuple[int, EpisodeRecord]] = []
    for record in choose(run, records, [word for word in words if word in several]):
        kind = (record.task, record.final_stage)
        ranked.append((seen[kind], record))
        seen[kind] += 1
    few = [record for _, record in sorted(ranked, key=lambda one: one[0])][:MOST]
    return [record for record in records if record in named or record in few]


def make_replays(
    folder: RunFolder,
    run: Run,
    records: Sequence[EpisodeRecord],
    *,
    import_tasks: bool = False,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> Made:
    """Make the missing replays of episodes of a run, where its report looks for them.

    Args:
        folder: The folder of the run.
        run: The run.
        records: Of which episodes.
        import_tasks: Whether to import tasks that are not of the benchmark, which runs the code of
            the modules that the run names. Their episodes have no replay without.
        progress: Called with how many of how many replays are there: once before the first one is
            made, then after each.

    Raises:
        OutputError: A replay cannot be written.
        DuoBenchError: A task of the run cannot be found, or its environment cannot be made.
    """
    return make_missing(
        run,
        records,
        lambda task: _Player(folder, run, task, import_tasks=import_tasks),
        is_there=lambda record: folder.replay(record.task, record.episode) is not None,
        excuses=(EvaluationError, ActionError, BackendError, UnknownNameError),
        progress=progress,
    )


class _Player:
    """Plays finished episodes of one task again; the environment is made once."""

    def __init__(
        self, folder: RunFolder, run: Run, claimed: TaskInfo, *, import_tasks: bool
    ) -> None:
        self._folder = folder
        self._run, self._claimed, self._import_tasks = run, claimed, import_tasks
        self._player: TargetPlayer | None = None
        self._scenes = SceneCache()

    def make(self, record: EpisodeRecord) -> None:
        scene, data = self.track(record)
        write(self._folder.scene(scene.name), scene.data)
        write(self._folder.new_replay(record.task, record.episode, scene.name), data)

    def track(self, record: EpisodeRecord) -> tuple[Geometry, bytes]:
        """The scene and the track of an episode.

        Raises:
            EvaluationError: It cannot be played, or comes out differently here.
            DuoBenchError: The same, or the environment cannot be made.
        """
        if reason := obstacle(record):
            raise EvaluationError(reason)
        if self._player is None:
            task = actual_task(self._claimed, import_tasks=self._import_tasks)
            self._player = TargetPlayer(task)
        collector = PoseCollector(self._scenes, as_look(record.config.look))
        replay = self._player.play(self._run, record, [collector])
        if found := disagreements(record, replay):
            raise EvaluationError(f"Played again here it comes out differently: {found[0]}.")
        if collector.geometry is None:
            raise EvaluationError("Nothing was played.")
        return collector.geometry, collector.track()

    def close(self) -> None:
        """Free the environment."""
        if self._player is not None:
            self._player.close()
