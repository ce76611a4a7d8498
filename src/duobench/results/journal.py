"""Journals of the writers of a run: one file each, which no other process writes.

A line says that an attempt at an episode begins, before it does, and another one how it ended and
how long it took. Records say what attempts there were, and no time of the clock.
"""

import math
import os
from collections import defaultdict
from collections.abc import (
    Callable,
    Iterable,
    Iterator,
    Mapping,
    Sequence,
)
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import msgspec

from duobench.core.files import writing
from duobench.results.attempts import (
    ERROR,
    FAILURE,
    STOPPED,
    SUCCESS,
)
from duobench.results.records import Key, Record
from duobench.results.scores import Results

_MINUTE_S, _HOUR_S = 60, 3600
_MOST = 10_000  # attempts at one episode


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeTimes:
    """Times of an episode in seconds."""

    total: float
    """Time from its environment to its record."""
    simulation: float
    rendering: float
    policy: float
    """Time in which the policy acts; for one at a server of others, until its chunks arrive."""
    waiting: float
    """Time of waiting for the policy's process, and of transport."""
    video: float


PARTS = tuple(field.name for field in fields(EpisodeTimes))[1:]
"""Fields of `EpisodeTimes` that are parts of the total; the rest of it is preparation."""


class Started(
    msgspec.Struct, tag="started", tag_field="kind", frozen=True, kw_only=True
):
    """A writer starts, or goes on."""

    command: str
    """The command that started it; empty if there was none."""
    workers: int
    """Processes that play side by side; 0 if the writer itself plays."""


class _AttemptLine(msgspec.Struct, frozen=True, kw_only=True):
    task: str
    condition: str
    episode: int
    attempt: Annotated[int, msgspec.Meta(ge=1, le=_MOST)]
    """Number of the attempt from 1 on, over all writers and calls."""

    @property
    def key(self) -> Key:
        """The episode."""
        return Key(self.task, self.condition, self.episode)


class Begun(_AttemptLine, tag="begun", tag_field="kind", frozen=True, kw_only=True):
    """An attempt at an episode begins."""


class Ended(_AttemptLine, tag="ended", tag_field="kind", frozen=True, kw_only=True):
    """An attempt has ended."""

    how: str
    """One of `ENDS`."""
    steps: int = 0
    workers: int = 0
    times: EpisodeTimes | None = None
    """Times of the attempt; None if unknown, as when a policy had to be stopped."""


Entry = Started | Begun | Ended


def read_entries(path: Path) -> list[Entry]:
    """The lines of a journal; what is no entry, such as half a line after a crash, is left out."""
    entries: list[Entry] = []
    for line in path.read_bytes().splitlines() if path.exists() else ():
        with suppress(msgspec.MsgspecError, RecursionError):
            entries.append(msgspec.json.decode(line, type=Entry))
    return entries


def end_of(record: Record) -> str:
    """End of an attempt that has a record."""
    return ERROR if record.error else SUCCESS if record.success else FAILURE


def read_attempts(entries: Iterable[Entry]) -> dict[Key, tuple[str, ...]]:
    """Ends of the attempts at each episode, first to last, as noted by writers.

    One that two journals began, and that ended in two ways, is two: folders of one run in which
    both were played were copied together.
    """
    found: defaultdict[Key, dict[int, Ended | None]] = defaultdict(dict)
    begun_again: dict[tuple[Key, int], Ended] = {}
    twins: defaultdict[Key, list[str]] = defaultdict(list)
    for entry in entries:
        match entry:
            case Begun():
                before = found[entry.key].setdefault(entry.attempt, None)
                if before:
                    begun_again[entry.key, entry.attempt] = before
            case Ended():
                found[entry.key][entry.attempt] = entry
                before = begun_again.pop((entry.key, entry.attempt), entry)
                if (before.how, before.steps) != (entry.how, entry.steps):
                    twins[entry.key].append(before.how)
            case Started():
                pass
    return {
        key: (*twins[key], *_ends(noted, len(twins[key])))
        for key, noted in found.items()
    }


def _ends(noted: Mapping[int, Ended | None], twins: int) -> Iterator[str]:
    for number in range(1, 1 + max(noted)):
        if number not in noted and twins:
            twins -= 1  # the one after a twin has counted it
            continue
        end = noted.get(number)
        yield STOPPED if end is None else end.how


class Journal:
    """The journal of one writer, which goes on with a file.

    Args:
        path: The file.
        entries: Reads what all writers have noted so far, from which attempts are counted.
    """

    def __init__(
        self, path: Path, entries: Callable[[], Iterable[Entry]] = tuple
    ) -> None:
        self._path, self._entries = path, entries
        self._attempts = read_attempts(entries())
        self._workers = 0

    def start(self, command: str, workers: int) -> None:
        """Note what starts this writer."""
        self._workers = workers
        with writing(self._path), self._path.open("ab") as file:
            if self._path.read_bytes()[-1:] not in {b"", b"\n"}:
                file.write(b"\n")  # after half a line of one that was killed
        self._add(Started(command=command, workers=workers))

    def earlier(self, key: Key) -> tuple[str, ...]:
        """Ends of the earlier attempts at an episode, without the last or current one."""
        return self._attempts.get(key, ())[:-1]

    def begin(self, key: Key) -> None:
        """Note that an attempt at an episode begins."""
        self._attempts[key] = (*self._attempts.get(key, ()), STOPPED)
        self._add(Begun(**key._asdict(), attempt=len(self._attempts[key])))

    def end(self, record: Record, times: EpisodeTimes | None) -> None:
        """Note that an episode has a record, and how long it took, in whole milliseconds."""
        how = end_of(record)
        rounded = times and EpisodeTimes(
            **{
                field.name: round(getattr(times, field.name), 3)
                for field in fields(times)
            }
        )
        self.lose(
            record.key, how, steps=record.steps, workers=self._workers, times=rounded
        )

    def lose(
        self,
        key: Key,
        how: str,
        **facts: Any,
    ) -> None:
        """Note how an attempt ended, one of `ENDS`."""
        ends = self._attempts[key] = (*self.earlier(key), how)
        self._add(
            Ended(
                **key._asdict(),
                attempt=len(ends),
                how=how,
                **facts,
            )
        )

    def clear(self) -> None:
        """Forget what the file says; attempts that are in it count no more."""
        with writing(self._path):
            os.truncate(self._path, 0)
        self._attempts = read_attempts(self._entries())

    def _add(self, entry: Entry) -> None:
        with writing(self._path), self._path.open("ab") as file:
            file.write(msgspec.json.encode(entry) + b"\n")


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeRow:
    """Times of some episodes together."""

    label: str
    episodes: int
    """Number of episodes whose time is known."""
    total: float
    """Sum of their times in seconds."""
    parts: tuple[float, ...]
    """Sums of their `PARTS`, and of the rest, in seconds."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RunTimes:
    """Times of a run."""

    rows: tuple[TimeRow, ...]
    """Task by task where a time is known, then all together where there are several tasks."""
    unknown: int
    """Finished episodes of which no time is known."""
    workers: tuple[int, ...]
    """Numbers of processes with which writers played, each number once."""


def run_times(results: Results, entries: Iterable[Entry]) -> RunTimes:
    """Sum up the times of finished episodes (last attempts), as noted by writers."""
    notes = {entry.key: entry for entry in entries if isinstance(entry, Ended)}
    by_task = [
        (
            one.task.title,
            [notes[record.key] for record in one.records if record.key in notes],
        )
        for one in results.tasks
    ]
    known = [note for _, ours in by_task for note in ours if note.times]
    rows = [row for label, ours in by_task if (row := _row(label, ours)).episodes]
    return RunTimes(
        rows=(*rows, _row("All tasks", known)) if len(rows) > 1 else tuple(rows),
        unknown=results.overall.episodes - len(known),
        workers=tuple(sorted({max(1, note.workers) for note in known})),
    )


def _row(label: str, notes: Iterable[Ended]) -> TimeRow:
    known = [note.times for note in notes if note.times]
    total = math.fsum(times.total for times in known)
    parts = [math.fsum(getattr(times, name) for times in known) for name in PARTS]
    rest = max(0.0, total - math.fsum(parts))
    return TimeRow(
        label=label,
        episodes=len(known),
        total=total,
        parts=(*parts, rest),
    )


def duration(seconds: float) -> str:
    """A time for people: "0.67 s", "12 s", "3 min 05 s", "2 h 07 min"."""
    if seconds < _MINUTE_S:
        return f"{seconds:.2f} s" if round(seconds, 1) < 10 else f"{seconds:.0f} s"  # noqa: PLR2004
    if round(seconds) < _HOUR_S:
        return "{} min {:02} s".format(*divmod(round(seconds), _MINUTE_S))
    return "{} h {:02} min".format(*divmod(round(seconds / _MINUTE_S), _MINUTE_S))


def side_by_side(workers: Sequence[int], writers: int) -> str:
    """Note on the times with several workers and writers, a sentence."""
    if writers > 1:
        return (
            f"Episodes were played by {writers} writers, each of which plays a shard: where they "
            "played side by side, less time passed than the sum."
        )
    if max(workers, default=1) == 1:
        return "Episodes were played one after the other."
    several = " or ".join(map(str, workers))
    return (
        f"These are times of {several} workers side by side: less time passed than their sum, and "
        "an episode takes longer beside others than alone."
    )
