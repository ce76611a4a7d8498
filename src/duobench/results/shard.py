"""A shard: one of several parts of a run, each played by a writer of its own into one folder."""

import math
import re
from dataclasses import dataclass

from duobench.errors import EvaluationError

MAX_SHARDS = 10_000


@dataclass(frozen=True, kw_only=True, slots=True, order=True)
class Shard:
    """Which part of a run this is: a number from 1 to the count of all parts.

    Together all parts are the run, whatever its episodes grow to. They are dealt out one by one, a
    task beginning where the one before began plus one, so that every part has some of each task,
    and an episode never moves to another part.
    """

    count: int
    number: int

    def __post_init__(self) -> None:
        if not 1 <= self.count <= MAX_SHARDS:
            raise EvaluationError(f"A run has 1 to {MAX_SHARDS} shards, got {self.count}.")
        if not 1 <= self.number <= self.count:
            raise EvaluationError(
                f"Shards count from 1: of {self.count} there are 1 to {self.count}, got "
                f"{self.number}."
            )

    @classmethod
    def parse(cls, text: str, between: str = "/") -> "Shard":
        """A shard from text such as "3/16", the third of sixteen, or "3-of-16"."""
        found = re.fullmatch(rf"([0-9]{{1,9}}){between}([0-9]{{1,9}})", text)
        if not found:
            raise EvaluationError(
                f"A shard is NUMBER/COUNT, such as 1/4 for the first of four; got {text!r}."
            )
        return cls(number=int(found[1]), count=int(found[2]))

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @property
    def writer(self) -> str:
        """What its writer is called, such as "3-of-16"."""
        return f"{self.number}-of-{self.count}"

    @property
    def is_whole(self) -> bool:
        """Whether it is all of a run."""
        return self.count == 1

    def part(self, task: int, episodes: range) -> range:
        """Those of the episodes of a task, by its place in the run from 0, that are in it."""
        # Episode i of task t is in the shard whose number is (t + i) modulo the count, plus 1.
        first = (self.number - 1 - task - episodes.start) % self.count
        return range(episodes.start + first, episodes.stop, self.count)

    def overlaps(self, other: "Shard") -> bool:
        """Whether an episode may be in both."""
        return (self.number - other.number) % math.gcd(self.count, other.count) == 0


WHOLE = Shard(number=1, count=1)
