"""Makes what is missing of finished episodes, task by task: their videos, or their replays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Protocol

from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import TaskInfo


@dataclass(frozen=True, kw_only=True, slots=True)
class Made:
    """What became of chosen episodes."""

    made: tuple[EpisodeRecord, ...]
    """Episodes of which something was made now."""
    there: tuple[EpisodeRecord, ...]
    """Episodes of which it was there already; it stays."""
    impossible: tuple[tuple[EpisodeRecord, str], ...]
    """Episodes of which it cannot be made, and why."""


class Maker(Protocol):
    """Makes something of episodes of one task."""

    def make(self, record: EpisodeRecord) -> None:
        """Make it, and write it where the run's report looks for it."""
        ...

    def close(self) -> None:
        """Free what was needed for it."""
        ...


def make_missing(
    run: Run,
    records: Sequence[EpisodeRecord],
    maker: Callable[[TaskInfo], Maker],
    *,
    is_there: Callable[[EpisodeRecord], bool],
    excuses: tuple[type[Exception], ...],
    progress: Callable[[int, int], None],
) -> Made:
    """Make what is missing of episodes.

    Args:
        run: The run.
        records: Of which of its episodes.
        maker: What makes it for a task.
        is_there: Whether it is there already.
        excuses: Errors of a maker after which the other episodes can still be made.
        progress: Called with how many of how many are there: once before the first one is made,
            then after each.

    Raises:
        DuoBenchError: A maker raised another error than an excuse.
    """
    there = [record for record in records if is_there(record)]
    missing = [record for record in records if record not in there]
    made: list[EpisodeRecord] = []
    impossible: list[tuple[EpisodeRecord, str]] = []
    progress(len(there), len(records))
    for task in run.suite.tasks:
        with closing(maker(task)) as one:
            for record in missing:
                if record.task != task.id:
                    continue
                try:
                    one.make(record)
                except excuses as error:
                    impossible.append((record, str(error)))
                else:
                    made.append(record)
                progress(len(there) + len(made) + len(impossible), len(records))
    return Made(made=tuple(made), there=tuple(there), impossible=tuple(impossible))
