"""How episodes failed: how far they came, and which constraints of the next stage did not hold."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from duobench.results.metrics import TaskResult
from duobench.results.records import EpisodeRecord

_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?!\w)")
"""A number that is a word of its own, not a part of a name."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Unmet:
    """A constraint that did not hold in some episodes."""

    text: str
    """What did not hold, in words; a number that is not the same in all of them is a range."""
    count: int
    """In how many episodes."""


@dataclass(frozen=True, kw_only=True, slots=True)
class FailedStage:
    """The episodes of a task that failed after the same stage."""

    stage: int
    """The last stage that they reached, 0 for none."""
    records: tuple[EpisodeRecord, ...]
    """The episodes, by index."""
    unmet: tuple[Unmet, ...]
    """What did not hold of the next stage, most frequent first."""

    @property
    def errors(self) -> int:
        """How many of them failed with an error."""
        return sum(record.error is not None for record in self.records)

    @property
    def unexplained(self) -> int:
        """How many of them have a record that does not say what did not hold."""
        return sum(not (record.error or record.unmet) for record in self.records)


def failed_stages(result: TaskResult) -> tuple[FailedStage, ...]:
    """The failed episodes of a task by the last stage that they reached, lowest first."""
    failed = [record for record in result.records if not record.success]
    return tuple(
        FailedStage(stage=stage, records=tuple(ours), unmet=_unmet(ours))
        for stage in range(result.task.max_stage + 1)
        if (ours := [record for record in failed if record.final_stage == stage])
    )


def _unmet(records: Iterable[EpisodeRecord]) -> tuple[Unmet, ...]:
    """What did not hold in episodes, without those that an error ended."""
    alike: dict[str, list[str]] = {}
    for record in records:
        if record.error is None:
            for text in dict.fromkeys(record.unmet or ()):
                alike.setdefault(_NUMBER.sub("#", text), []).append(text)
    found = [Unmet(text=_merged(texts), count=len(texts)) for texts in alike.values()]
    return tuple(sorted(found, key=lambda one: (-one.count, one.text)))


def _merged(texts: Sequence[str]) -> str:
    """One sentence for several that differ in numbers only: "20 to 50 mm above mat"."""
    columns = zip(*(_NUMBER.findall(text) for text in texts), strict=True)
    ranges = (_range(column) for column in columns)
    return _NUMBER.sub(lambda _: next(ranges), texts[0])


def _range(numbers: Sequence[str]) -> str:
    low, high = min(numbers, key=float), max(numbers, key=float)
    return low if float(low) == float(high) else f"{low} to {high}"
