"""Rows of a recording that are used: exported, learned from, counted.

Everything that turns recordings into training data asks `used_rows`, which leaves rows out for
reasons that it counts. Idle ones stand for nothing of their own: a row that is used stands for the
idle ones behind it too, whose rewards it is paid, and leads to what was seen after them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import OptionError
from duobench.core.types import Array

if TYPE_CHECKING:
    from duobench.data.recording import Recording

Span = tuple[int, int]
"""Row numbers from one on and up to another, without that one."""


class Reason(StrEnum):
    """Reason why rows are left out."""

    IDLE = "idle"
    """No clutch was closed, no target moved, and nothing else did."""
    UNCORRECTED = "uncorrected"
    """A policy led them, or nobody took over soon after, and corrections are wanted."""
    TRIMMED = "trimmed"
    """They are outside what a review left of the recording."""


@dataclass(frozen=True, kw_only=True)
class RowChoice:
    """Which rows of them are exported."""

    keep_idle: bool = False
    """Export rows too in which an operator led nothing and nothing moved."""
    only_corrections: bool = False
    """Export only rows that a person led in the place of a policy; every stretch of them becomes an
    episode of its own."""
    from_takeover: int | None = None
    """Export only rows from so many before the first take-over of a policy on; with
    only-corrections, so many before each one are added."""

    def __post_init__(self) -> None:
        before = self.from_takeover
        if before is not None and (not isinstance(before, int) or before < 0):
            raise OptionError(
                f"Rows before a take-over are a whole number from 0 on, got {before!r}."
            )


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """Some of the n rows that are used, each with all that it stands for."""

    rows: NDArray[np.int64]
    """Row numbers (n,) in the recording."""
    starts: NDArray[np.int64]
    """First rows (n,) that they stand for: their own, or earlier where idle ones come first."""
    ends: NDArray[np.int64]
    """Rows (n,) that they lead to, whose numbers may be that of the last one."""
    before: NDArray[np.int64]
    """Rows (n,) whose actions led to them; -1 where the episode begins."""

    def __len__(self) -> int:
        return len(self.rows)

    def added(self, rewards: Array) -> Array:
        """What each step was paid (n,), of the rewards of all rows."""
        bounds = np.column_stack([self.starts, self.ends]).ravel()
        return np.add.reduceat(np.append(rewards, 0.0), bounds)[::2]


@dataclass(frozen=True, kw_only=True, slots=True)
class UsedRows:
    """Rows of a recording that are used."""

    spans: tuple[Span, ...]
    """Rows that are used."""
    idle: tuple[Span, ...] = ()
    """Rows that are left out as idle, so that the one before them leads to the one behind them."""
    left_out: dict[Reason, int] = field(default_factory=dict)
    """How many are left out for each reason."""

    @staticmethod
    def every(length: int) -> UsedRows:
        """All rows of a recording."""
        return UsedRows(spans=((0, length),) if length else ())

    def stretches(self) -> tuple[UsedRows, ...]:
        """Its rows in parts that follow each other without a gap, but for idle rows.

        The first one says what is left out.
        """
        bounds = _numbers(self.spans + self.idle)
        bounds.sort()
        parts = []
        for part in np.split(bounds, 1 + np.flatnonzero(np.diff(bounds) > 1)):
            within = slice(part[0], part[-1] + 1) if len(part) else slice(0)
            spans = tuple(span for span in self.spans if _is_in(span, within))
            idle = tuple(span for span in self.idle if _is_in(span, within))
            left_out = {} if parts else self.left_out
            if spans:
                parts.append(
                    UsedRows(
                        spans=spans,
                        idle=idle,
                        left_out=left_out,
                    )
                )
        return tuple(parts)

    def steps(self, every: int = 1) -> Steps:
        """Each so many of the rows that are used; they begin anew where rows are missing."""
        numbers = _numbers(self.spans)
        end = max((end for _, end in (*self.spans, *self.idle)), default=0)
        # What is not idle, with a row on each side.
        bounds = np.setdiff1d(np.arange(-1, end + 1), _numbers(self.idle))
        place = np.searchsorted(bounds, numbers)
        earlier = bounds[place - 1]
        follows = np.isin(earlier, numbers)
        starts = np.where(follows, numbers, earlier + 1)
        before = np.where(follows, earlier, numbers - 1)
        heads = np.append(np.flatnonzero(~follows), len(numbers))
        firsts = np.array(
            [
                each
                for head, last in pairwise(heads)
                for each in range(head, last, every)
            ],
            np.int64,
        )
        lasts = np.append(firsts, len(numbers))[1:] - 1
        return Steps(
            rows=numbers[firsts],
            starts=starts[firsts],
            ends=bounds[place + 1][lasts],
            before=before[firsts],
        )


def used_rows(
    recording: Recording,
    choice: RowChoice,
    task: str,
    *,
    within: Span | None = None,
) -> UsedRows:
    """Rows of a recording that are used.

    Args:
        recording: The episode, as far as its rows may be used.
        choice: Which rows are wanted.
        task: Reference of its task, as `DataSet.reference` gives it.
        within: Rows that a review left of it.
    """
    taken = np.ones(len(recording), np.bool_)
    left_out: dict[Reason, int] = {}
    if within is not None:
        kept = np.zeros_like(taken)
        kept[slice(*within)] = True
        left_out[Reason.TRIMMED] = int((taken & ~kept).sum())
        taken &= kept
    if choice.only_corrections or choice.from_takeover is not None:
        corrected = _corrected(recording, choice)
        left_out[Reason.UNCORRECTED] = int((taken & ~corrected).sum())
        taken &= corrected
    idle = np.zeros_like(taken)
    if recording.info.has_clutch and not choice.keep_idle:
        from duobench.data.idle import idle_rows  # loads the engine

        for span in _spans(taken):
            idle[slice(*span)] = idle_rows(recording, task, span)
        left_out[Reason.IDLE] = int(idle.sum())
    return UsedRows(
        spans=_spans(taken & ~idle),
        idle=_spans(idle),
        left_out={reason: count for reason, count in left_out.items() if count},
    )


def _corrected(recording: Recording, choice: RowChoice) -> NDArray[np.bool_]:
    """Rows (T,) that take-overs are about."""
    before = choice.from_takeover or 0
    wanted = np.zeros(len(recording), np.bool_)
    for begin, end, _ in recording.corrections:
        last = end if choice.only_corrections else None
        wanted[max(0, begin - before) : last] = True
    return wanted


def _is_in(span: Span, within: slice) -> bool:
    """Whether a span begins within some rows."""
    return within.start <= span[0] < within.stop


def _numbers(spans: Sequence[Span]) -> NDArray[np.int64]:
    """The row numbers of spans."""
    return np.concatenate([np.arange(*span) for span in spans] or [np.arange(0)])


def _spans(mask: NDArray[np.bool_]) -> tuple[Span, ...]:
    """The rows that a mask (T,) marks, as spans."""
    bounds = np.flatnonzero(np.diff(mask, prepend=False, append=False)).tolist()
    return tuple(zip(bounds[::2], bounds[1::2], strict=True))
