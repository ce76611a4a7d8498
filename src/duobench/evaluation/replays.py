"""Replays of finished episodes in 3D: the tracks of their bodies, for the page of a report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field

import gymnasium as gym
from numpy.typing import NDArray

from duobench.envs.sim_env import sim_of
from duobench.errors import EvaluationError
from duobench.evaluation.rollout import Info, Observation, Step
from duobench.evaluation.sent import SentPlayer, check_suite
from duobench.evaluation.videos import ALL, FAILURES, choose
from duobench.files import write
from duobench.results.folder import RunFolder
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.web import track
from duobench.web.geometry import Geometry

MOST = 20
"""Replays that a word such as "failures" chooses at most: they make a page of about 2 MB."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Replays:
    """What became of the replays of chosen episodes."""

    made: tuple[EpisodeRecord, ...]
    """Episodes whose replay was made now."""
    there: tuple[EpisodeRecord, ...]
    """Episodes whose replay was there already, which stays."""
    impossible: tuple[tuple[EpisodeRecord, str], ...]
    """Episodes that have no replay, and why."""


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
) -> Replays:
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
        EvaluationError: The run is of another suite version.
        OutputError: A replay cannot be written.
        DuoBenchError: A task of the run cannot be found, or its environment cannot be made.
    """
    check_suite(run)
    there = [each for each in records if folder.replay(each.task, each.episode) is not None]
    missing = [each for each in records if each not in there]
    made: list[EpisodeRecord] = []
    impossible: list[tuple[EpisodeRecord, str]] = []
    progress(len(there), len(records))
    for task in run.suite.tasks:
        with closing(SentPlayer(task, import_tasks=import_tasks)) as player:
            for record in missing:
                if record.task != task.id:
                    continue
                watcher = TrackRecorder()
                try:
                    player.play(record, watcher)
                except EvaluationError as error:
                    impossible.append((record, str(error)))
                else:
                    scene = watcher.geometry
                    write(folder.scene(scene.name), scene.data)
                    write(folder.new_replay(task.id, record.episode, scene.name), watcher.track())
                    made.append(record)
                progress(len(there) + len(made) + len(impossible), len(records))
    return Replays(made=tuple(made), there=tuple(there), impossible=tuple(impossible))


@dataclass(slots=True)
class TrackRecorder:
    """Watches an episode, and keeps where its bodies were: at its start, and after every step."""

    _env: gym.Env | None = None
    _geometry: Geometry | None = None
    _poses: list[NDArray] = field(default_factory=list)

    @property
    def geometry(self) -> Geometry:
        """What was seen of the model, with the variants of the episode."""
        if self._geometry is None:
            raise RuntimeError("No episode has begun.")
        return self._geometry

    def track(self) -> bytes:
        """The track, with one row more than the episode has control steps."""
        return track.encode(self._poses)

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """Note what there is, and where."""
        self._env = env
        self._geometry = Geometry(sim_of(env).simulation.model)
        self._look()

    def on_step(self, step: Step) -> None:  # noqa: ARG002 - the protocol's signature
        """Note where everything is now."""
        self._look()

    def on_episode_end(self, error: BaseException | None) -> None:
        """There is nothing to do."""

    def _look(self) -> None:
        if self._env is not None:
            self._poses.append(self.geometry.poses(sim_of(self._env).simulation.data))
