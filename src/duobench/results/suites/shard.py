"""A shard: one of several parts of a run, each played by itself into a folder of its own."""

from __future__ import annotations

import re
from dataclasses import dataclass

from duobench.errors import EvaluationError

MAX_SHARDS = 10_000
"""Most parts of a run."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Shard:
    """Which part of a run this is. Together all parts are the run, whatever its episodes grow to.

    Episodes are dealt out one by one, a task beginning where the one before began plus one, so that
    every part has some of each task, and an episode never moves to another part.
    """

    number: int
    """Its number, from 1 to `count`."""
    count: int
    """How many parts there are."""

    def __post_init__(self) -> None:
        """Reject a part that does not exist."""
        if not 1 <= self.count <= MAX_SHARDS:
            raise EvaluationError(f"A run has 1 to {MAX_SHARDS} shards, got {self.count}.")
        if not 1 <= self.number <= self.count:
            raise EvaluationError(
                f"Shards count from 1: of {self.count} there are 1 to {self.count}, got "
                f"{self.number}."
            )

    @classmethod
    def parse(cls, text: str) -> Shard:
        """A shard from text such as "3/16", the third of sixteen.

        Raises:
            EvaluationError: It is no such text, or there is no such shard.
        """
        found = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text)
        if found is None:
            raise EvaluationError(
                f"A shard is NUMBER/COUNT, such as 1/4 for the first of four; got {text!r}."
            )
        return cls(number=int(found[1]), count=int(found[2]))

    def __str__(self) -> str:
        """The text that `parse` takes."""
        return f"{self.number}/{self.count}"

    @property
    def folder(self) -> str:
        """Name of its folder in that of the run."""
        return f"shard-{self.number}-of-{self.count}"

    def part(self, task: int, episodes: range) -> range:
        """Those of the episodes of a task that are in it.

        Args:
            task: Place of the task in the run, from 0.
            episodes: Indices of the episodes of the run, without gaps.
        """
        # Episode i of task t is in the shard whose number is (t + i) modulo the count, plus 1.
        first = (self.number - 1 - task - episodes.start) % self.count
        return range(episodes.start + first, episodes.stop, self.count)
