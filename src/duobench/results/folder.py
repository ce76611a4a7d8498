"""The folder of a run: self-describing records, written by any number of writers.

`records/TASK/CONDITION/INDEX.json` names every episode, so that writers never meet and the folders
of two machines are merged by copying one into the other. Every record names the description of its
run (`run.json`, the same for all writers) by its hash; records of two runs are refused.
"""

import re
import shutil
from abc import ABC, abstractmethod
from collections.abc import Container, Generator, Iterable
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from duobench.core.errors import (
    EvaluationError,
    FileError,
    LockedError,
    OtherRunError,
)
from duobench.core.files import (
    Readable,
    begin_or_continue,
    check_there,
    encode,
    files_in,
    held,
    is_locked,
    locked,
    make_folder,
    read,
    remove,
    remove_temporary,
    taken_back,
    write,
    writing,
)
from duobench.results.attempts import ERROR, FAILURE, SUCCESS
from duobench.results.journal import (
    Begun,
    Entry,
    Journal,
    Started,
    read_attempts,
    read_entries,
)
from duobench.results.records import (
    RECORD_SCHEMA,
    Condition,
    Key,
    Record,
)
from duobench.results.run import (
    RUN_SCHEMA,
    WHOLE,
    Run,
    Shard,
)
from duobench.results.suite import Episode

DESCRIPTION = "run.json"
RUN_BEGINNINGS = (DESCRIPTION, "attempts/*.jsonl")
"""Files that a run begins with; without an attempt they are worth nothing."""
CONDITIONS = "conditions"
"""Folder of the pages of each condition, where there are several."""
VIDEO_SUFFIX = ".webm"
TRACK_SUFFIX, SCENE_SUFFIX = ".track", ".scene"
RECORDED = {SUCCESS, FAILURE, ERROR}
"""Ends of attempts that have a record."""
_WAIT_S = 30.0  # seconds that a writer waits for others, which begin in the folder too
_REPORT = (
    "index.html",
    "summary.json",
    "robustness.json",
    "comparison.json",
    "table.md",
    "table.csv",
    "table.tex",
    "figures/stages.svg",
    "figures/progress.svg",
    "figures/levels.svg",
)
_RECORD = re.compile(r"records/([^/]+)/([^/]+)/([0-9]+)\.json")


def record_name(key: Key) -> str:
    """The file of an episode's record in the folder of its run."""
    return f"records/{key.path}.json"


class RunReader(ABC):
    """A run and the records of its finished episodes, read file by file."""

    advice = ""
    """Advice about a record that cannot be read."""

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()
        """Folder that is read."""

    @abstractmethod
    def file(self, name: str) -> Readable:
        """A file by its name, whether or not there is one."""

    @abstractmethod
    def names(self) -> Iterable[str]:
        """Names of all records."""

    @abstractmethod
    def commands(self) -> list[str]:
        """The commands that its writers were last started with, each once."""

    @abstractmethod
    def attempts(self) -> dict[str, tuple[str, ...]]:
        """Ends of the attempts at each episode, first to last, by the path of its key.

        Each is one of `duobench.results.attempts.ENDS`; of what was not noted nothing is known.
        """

    def read_run(self) -> Run:
        """Read the description of the run."""
        return read(self.file(DESCRIPTION), Run, RUN_SCHEMA)

    def finished(self, run: Run) -> list[Key]:
        """Episodes that have a record: condition by condition, task by task."""
        conditions = {name: place for place, name in enumerate(run.conditions)}
        tasks = {task.id: place for place, task in enumerate(run.suite.tasks)}
        found: list[Key] = []
        for name in self.names():
            match = _RECORD.fullmatch(name)
            key = Key(match[1], match[2], int(match[3])) if match else Key("", "", 0)
            is_known = key.task in tasks and key.condition in conditions
            if (
                not is_known
                or key.episode not in run.suite.indices
                or record_name(key) != name
            ):
                raise EvaluationError(
                    f"{self.path} has a record of no episode of its run, {name}: {DESCRIPTION} "
                    f"says {run.suite.episodes} episodes of {len(tasks)} tasks under "
                    f"{len(conditions)} conditions. It was renamed, or copied from another run, or "
                    f"from a part of this one with more to play, whose {DESCRIPTION} belongs to "
                    "all. Parts of which none plays all are whole once the run of all their tasks, "
                    "axes and levels goes on in this folder."
                )
            found.append(key)
        return sorted(
            found, key=lambda key: (conditions[key.condition], tasks[key.task], key[2])
        )

    def removed(self, run: Run) -> str:
        """A sentence about what was played, as journals say, and has no record; empty if none."""
        there = {key.path for key in self.finished(run)}
        ended = (
            path for path, ends in self.attempts().items() if RECORDED & {*ends[-1:]}
        )
        lost = sorted(set(ended) - there)
        return (
            f"Played, and without a record now: {len(lost)}, such as {lost[0]}."
            if lost
            else ""
        )

    def read_record(self, run: Run, key: Key) -> Record:
        """The record of one episode of a run."""
        return self._record(run, run.hash, run.conditions[key.condition], key)

    def read_records(
        self, run: Run, wanted: Container[Key] | None = None
    ) -> list[Record]:
        """The records of the finished episodes, or of those that are wanted, in the run's order.

        Raises:
            FileError: If a record cannot be read.
            OtherRunError: If one is of another run.
            EvaluationError: If one is of another episode.
        """
        conditions, digest = run.conditions, run.hash
        return [
            self._record(run, digest, conditions[key.condition], key)
            for key in self.finished(run)
            if wanted is None or key in wanted
        ]

    def _record(
        self,
        run: Run,
        digest: str,
        condition: Condition,
        key: Key,
    ) -> Record:
        file = self.file(record_name(key))
        record = read(
            file,
            Record,
            RECORD_SCHEMA,
            advice=self.advice,
        )
        (task,) = (task for task in run.suite.tasks if task.id == key.task)
        split = run.of(condition.policy).config.split
        episode = Episode(
            task=task, index=key.episode, split=split, shift=condition.shift
        )
        objection = run.objection(record, episode)
        if record.run != digest:
            raise OtherRunError(
                f"{file} belongs to another run than {DESCRIPTION} describes, though every record "
                f"of a folder is of one run: {objection or 'something else differs'} Take apart "
                "what was copied together, or give the run a folder of its own."
            )
        if objection:
            raise EvaluationError(
                f"{file} does not belong to this run: {objection} {self.advice}".strip()
            )
        return record


class RunFolder(RunReader):
    """Names in the folder of a run, and how it is begun, continued and written."""

    advice = "Delete the file and run the evaluation again: it plays only the missing episodes."

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.description = self.file(DESCRIPTION)
        self.summary = self.file("summary.json")
        self.page = self.file("index.html")

    def file(self, name: str) -> Path:
        """A file by its name, whether or not there is one."""
        return self.path / name

    def names(self) -> Iterable[str]:
        """Names of all records."""
        for path in self.path.glob("records/**/*.json"):
            yield path.relative_to(self.path).as_posix()

    def commands(self) -> list[str]:
        """The commands that its writers were last started with, each once."""
        last = {
            shard: entry.command
            for shard in self.writers
            for entry in read_entries(self.journal(shard))
            if isinstance(entry, Started)
        }
        return list(dict.fromkeys(filter(None, last.values())))

    def attempts(self) -> dict[str, tuple[str, ...]]:
        """Ends of the attempts at each episode, from the journals."""
        return {key.path: ends for key, ends in read_attempts(self.entries()).items()}

    def record(self, key: Key) -> Path:
        """Record of an episode."""
        return self.file(record_name(key))

    def video(self, key: Key) -> Path:
        """Video of an episode, if it has one."""
        return self.path / "videos" / f"{key.path}{VIDEO_SUFFIX}"

    def poster(self, key: Key) -> Path:
        """Image that stands for a video where none is played, if there is one."""
        return self.video(key).with_suffix(".jpg")

    def replay(self, key: Key) -> Path | None:
        """Track of an episode for its replay in 3D, if there is one."""
        # Its name ends with that of the scene: "00003.0123456789ab.track".
        path = self.path / "replays" / key.path
        found = sorted(path.parent.glob(f"{path.name}.*{TRACK_SUFFIX}"))
        return found[0] if found else None

    def new_replay(self, key: Key, scene: str) -> Path:
        """Path for the track of an episode, which is played in a scene."""
        return self.path / "replays" / f"{key.path}.{scene}{TRACK_SUFFIX}"

    def scene(self, name: str) -> Path:
        """Scene of replays for a browser."""
        return self.path / "replays" / "scenes" / f"{name}{SCENE_SUFFIX}"

    @property
    def has_records(self) -> bool:
        """Whether an episode is finished."""
        return any(self.names())

    @property
    def is_begun(self) -> bool:
        """Whether an attempt at an episode has begun, or another process is writing."""
        return len(self.writers) > 1 or any(
            isinstance(each, Begun) for each in self.entries()
        )

    # --- writers -----------------------------------------------------------------------------

    def journal(self, shard: Shard) -> Path:
        """Journal of the writer of a shard."""
        return self.path / "attempts" / f"{shard.writer}.jsonl"

    @property
    def writers(self) -> list[Shard]:
        """The shards that a writer has begun, in their order."""
        found: list[Shard] = []
        for path in self.path.glob("attempts/*.jsonl"):
            with suppress(EvaluationError):
                found.append(Shard.parse(path.stem, "-of-"))
        return sorted(found)

    def entries(self) -> list[Entry]:
        """Entries of all writers, one writer after the other."""
        return [
            entry
            for shard in self.writers
            for entry in read_entries(self.journal(shard))
        ]

    @contextmanager
    def writer(self, shard: Shard = WHOLE) -> Generator[Journal]:
        """Be the writer of a shard, with its journal, while a block lasts; a kill leaves no lock.

        A new folder is removed again where the block fails before anything is begun in it.

        Raises:
            OtherRunError: The folder holds files that belong to no run.
            LockedError: Another process writes the shard, or one that overlaps with it.
        """
        path = self.journal(shard)
        with ExitStack() as ending:
            new = taken_back(self.path, *RUN_BEGINNINGS, is_begun=lambda: self.is_begun)
            ending.enter_context(new)
            with locked(
                self.path, wait_s=_WAIT_S
            ):  # in which alone others' locks are looked at
                self._check_free()
                for other in self.writers:
                    if shard.overlaps(other):
                        with held(self.journal(other)):
                            pass
                make_folder(path.parent)
                with writing(path):
                    path.touch()
                ending.enter_context(held(path))
            yield Journal(path, self.entries)

    def begin(self, run: Run, shard: Shard = WHOLE) -> None:
        """Begin a run in this folder, or continue the one that is there.

        A run may grow: with more episodes or shifts than before, those that are there stay. A run
        that has not finished a single episode holds nothing to keep: its description is replaced,
        so that a mistake in it can be corrected, unless another process is writing it.

        Raises:
            OtherRunError: If the folder holds another run, or files that belong to none.
        """
        with locked(self.path, wait_s=_WAIT_S):
            is_shared = self._is_written_beside(shard)
            is_final = self.has_records or is_shared
            begin_or_continue(
                self.path,
                self.description,
                run,
                RUN_SCHEMA,
                what="evaluation",
                kept=[self.journal(each).name for each in self.writers],
                is_final=is_final,
            )
            if is_final:
                run = run.with_shifts_of(self.read_run())
            write(self.description, encode(run, RUN_SCHEMA))
            if not is_shared:
                remove_temporary(self.path)

    def gives_way(self, run: Run) -> bool:
        """Whether every episode of another run that is here, finished, failed with an error."""
        if not (self.has_records and self.description.exists()):
            return False
        other = self.read_run()
        records = self.read_records(other) if run.differences(other) else []
        return bool(records) and all(record.error is not None for record in records)

    def clear(
        self, run: Run, shard: Shard = WHOLE, *, keeps_attempts: bool = False
    ) -> None:
        """Remove what was played of a shard of a run, or all of another run that is here.

        Journals of other writers of that run go too, unless attempts are kept.
        """
        if not self.description.exists():
            return
        with locked(self.path, wait_s=_WAIT_S):
            if not shard.is_whole and self._holds(run):
                before = self.read_run()
                ours = set(before.episode_keys(shard))
                for key in self.finished(before):
                    if key in ours:
                        self.discard(key)
            elif self._is_written_beside(shard):
                raise LockedError(
                    f"Another process is writing another run into {self.path}."
                )
            else:
                self._clear_all([] if keeps_attempts else self._others(shard))

    def _holds(self, run: Run) -> bool:
        """Whether it holds this run, as far as that can be read."""
        with suppress(FileError):
            return self.read_run().hash == run.hash
        return False

    def _clear_all(self, journals: Iterable[Path]) -> None:
        for name in ("records", "videos", "replays", "figures", CONDITIONS):
            with writing(self.path / name), suppress(FileNotFoundError):
                shutil.rmtree(self.path / name)
        remove(*map(self.file, _REPORT), *journals)

    def _others(self, shard: Shard) -> list[Path]:
        """The journals of other writers."""
        return [self.journal(each) for each in self.writers if each != shard]

    def _is_written_beside(self, shard: Shard) -> bool:
        return any(map(is_locked, self._others(shard)))

    def _check_free(self) -> None:
        if self.description.exists():
            return
        paths = {*files_in(self.path)} - {self.journal(each) for each in self.writers}
        # Of one that was killed while it began.
        if not all(path.match(f".{DESCRIPTION}.*") for path in paths):
            raise OtherRunError(f"{self.path} is not empty and holds no evaluation.")

    def read_run(self) -> Run:
        """The description of the run.

        Raises:
            EvaluationError: If there is no run.
        """
        if not self.description.exists():
            raise EvaluationError(
                f"{self.path} holds no evaluation: {DESCRIPTION} is missing."
            )
        return super().read_run()

    def write(self, record: Record, video: bytes | None = None) -> None:
        """Write what an episode has left: its video first, so that a record means all of it."""
        check_there(self.path)
        if video is not None:
            write(self.video(record.key), video)
        write(self.record(record.key), encode(record, RECORD_SCHEMA))

    def discard(self, key: Key) -> None:
        """Remove what an episode has left, which makes it one that is still to be played."""
        names = (self.poster, self.video, self.replay, self.record)
        remove(*(path for name in names if (path := name(key))))
