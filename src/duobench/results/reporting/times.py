"""How long episodes took on the clock. No result depends on it, and no record holds it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import msgspec

from duobench.results.metrics import Results
from duobench.results.records import EpisodeRecord

_MINUTE_S, _HOUR_S = 60, 3600


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeTimes:
    """How long an episode took, in seconds."""

    total: float
    """From its environment to its record."""
    simulation: float
    """The reset, physics and stages."""
    rendering: float
    """Images that the policy sees."""
    policy: float
    """The policy's answers; for one at a server that somebody else runs, until they came."""
    waiting: float
    """For the policy's process: until it was this episode's turn, and on the way."""
    video: float
    """Images of the video, and their encoding."""


PARTS = ("simulation", "rendering", "policy", "waiting", "video")
"""Fields of `EpisodeTimes` that are parts of the total; the rest of it is preparation."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeNote:
    """One line of a run's `timing.jsonl`."""

    task: str
    """Id of the task."""
    episode: int
    """Index of the episode."""
    steps: int
    """Control steps that it had."""
    seconds: float | None
    """How long it took; None if its policy had to be stopped."""
    simulation: float | None = None
    """Parts of that, as in `EpisodeTimes`; None where only the whole is known."""
    rendering: float | None = None
    policy: float | None = None
    waiting: float | None = None
    video: float | None = None
    workers: int | None = None
    """How many processes played side by side; None if unknown."""

    @classmethod
    def of(cls, record: EpisodeRecord, times: EpisodeTimes | None, workers: int) -> TimeNote:
        """The note about an episode that was just played."""
        parts = {name: round(getattr(times, name), 3) for name in PARTS} if times else {}
        return cls(
            task=record.task,
            episode=record.episode,
            steps=record.steps,
            seconds=times and round(times.total, 3),
            workers=workers,
            **parts,
        )

    @property
    def has_parts(self) -> bool:
        """Whether its parts are known."""
        return None not in (getattr(self, name) for name in PARTS)


Notes = Mapping[tuple[str, int], TimeNote]
"""Notes by task and episode."""


def read_notes(*paths: Path) -> Notes:
    """The notes in files; none where there is no file.

    Lines that are no notes, such as one that a crash cut off, are left out. Of an episode that was
    played again the last one counts.
    """
    notes = {}
    lines = [path.read_bytes().splitlines() for path in paths if path.exists()]
    for line in chain.from_iterable(lines):
        with suppress(msgspec.MsgspecError):
            note = msgspec.json.decode(line, type=TimeNote)
            notes[note.task, note.episode] = note
    return notes


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeRow:
    """How long episodes took together."""

    label: str
    """Whose episodes: a task's title, or all of them."""
    episodes: int
    """Of how many the time is known."""
    total: float
    """Sum of their times in seconds."""
    parts: tuple[float, ...]
    """Sums of their `PARTS`, and of the rest, in seconds; empty if not known of all of them."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RunTimes:
    """How long a run took."""

    rows: tuple[TimeRow, ...]
    """Task by task where a time is known, then all together where there are several tasks."""
    unknown: int
    """Finished episodes of which no time is known."""
    workers: tuple[int | None, ...]
    """How many processes played side by side, each number once; None stands for an unknown one."""


def run_times(results: Results, notes: Notes) -> RunTimes:
    """How long the finished episodes of a run took."""
    by_task = [
        (one.task.title, [note for r in one.records if (note := notes.get((r.task, r.episode)))])
        for one in results.tasks
    ]
    known = [note for _, ours in by_task for note in ours if note.seconds is not None]
    rows = [row for label, ours in by_task if (row := _row(label, ours)).episodes]
    if len(rows) > 1:
        rows.append(_row("All tasks", known))
    numbers = {None if note.workers is None else max(1, note.workers) for note in known}
    return RunTimes(
        rows=tuple(rows),
        unknown=results.overall.episodes - len(known),
        workers=tuple(sorted(numbers, key=lambda number: number or 0)),
    )


def _row(label: str, notes: Iterable[TimeNote]) -> TimeRow:
    known = [note for note in notes if note.seconds is not None]
    total = math.fsum(note.seconds or 0.0 for note in known)
    parts: Sequence[float] = ()
    if all(note.has_parts for note in known):
        parts = [math.fsum(getattr(note, name) for note in known) for name in PARTS]
        parts = [*parts, max(0.0, total - math.fsum(parts))]
    return TimeRow(label=label, episodes=len(known), total=total, parts=tuple(parts))


def duration(seconds: float) -> str:
    """A time for people: "0.67 s", "12 s", "3 min 05 s", "2 h 07 min"."""
    if seconds < _MINUTE_S:
        return f"{seconds:.2f} s" if round(seconds, 1) < 10 else f"{seconds:.0f} s"  # noqa: PLR2004
    if round(seconds) < _HOUR_S:
        return "{} min {:02} s".format(*divmod(round(seconds), _MINUTE_S))
    return "{} h {:02} min".format(*divmod(round(seconds / _MINUTE_S), _MINUTE_S))


def side_by_side(workers: Sequence[int | None]) -> str:
    """What the number of workers means for the times, in a sentence."""
    numbers = [number for number in workers if number is not None]
    if None in workers:
        return (
            "It is not known how many episodes were played side by side, so less time may have "
            "passed than their sum."
        )
    if max(numbers, default=1) == 1:
        return "Episodes were played one after the other."
    several = " or ".join(map(str, numbers))
    return (
        f"These are times of {several} workers side by side: less time passed than their sum, and "
        "an episode takes longer beside others than alone."
    )
