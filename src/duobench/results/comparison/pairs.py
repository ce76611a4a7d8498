"""Two runs against each other: every test, row by row of the table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

from duobench.results.comparison.entrants import Entrant
from duobench.results.comparison.pairing import (
    Pairs,
    common_tasks,
    differing_conditions,
    obstacle,
    same_episodes,
)
from duobench.results.comparison.rows import Kind, Row
from duobench.results.records import EpisodeRecord
from duobench.results.statistics import (
    LEVEL,
    barnard,
    cohen_h,
    episodes_needed,
    holm,
    mcnemar,
    newcombe_interval,
    paired_permutation,
    permutation,
    tango_interval,
)


@dataclass(frozen=True, kw_only=True, slots=True)
class Test:
    """What tests say about two runs in one row of the table; differences are first minus second."""

    row: Row
    """The row."""
    episodes: tuple[int, int]
    """Episodes of either run that were tested."""
    successes: tuple[int, int]
    """How many of them succeeded."""
    only: tuple[int, int] | None
    """Episodes that only one of both solved; None if the episodes are not the same."""
    interval: tuple[float, float]
    """95 % interval of the difference of success rates."""
    p: float
    """Of the test of success."""
    adjusted: float
    """The same after Holm, over the rows of this kind."""
    progress: float
    """Difference of mean final progress."""
    progress_p: float
    """Of the permutation test of final progress."""
    progress_adjusted: float
    """The same after Holm, over the rows of this kind."""
    more_episodes: int | None = None
    """About how many more would show the difference that was seen; None where that is unknown."""

    def turned(self) -> Test:
        """The same with the second run first."""
        low, high = self.interval
        return replace(
            self,
            episodes=self.episodes[::-1],
            successes=self.successes[::-1],
            only=self.only and self.only[::-1],
            interval=(-high, -low),
            progress=-self.progress,
        )

    @property
    def rates(self) -> tuple[float, float]:
        """Success rates of the tested episodes."""
        a, b = (k / n for k, n in zip(self.successes, self.episodes, strict=True))
        return a, b

    @property
    def difference(self) -> float:
        """Difference of success rates."""
        return self.rates[0] - self.rates[1]

    @property
    def effect(self) -> float:
        """Cohen's h."""
        return cohen_h(*self.rates)

    @property
    def better(self) -> int:
        """1 if the first run solves more, -1 if the second does, 0 if nobody can tell."""
        return _sign(self.difference) if self.adjusted <= LEVEL else 0

    @property
    def further(self) -> int:
        """1 if the first run has more progress, -1 if the second has, 0 if nobody can tell."""
        return _sign(self.progress) if self.progress_adjusted <= LEVEL else 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Pair:
    """Two runs against each other."""

    a: Entrant
    """The first run."""
    b: Entrant
    """The second one."""
    paired: bool
    """Whether the tests are about the same episodes."""
    obstacle: str | None
    """Why nothing is tested, if nothing is."""
    conditions: tuple[str, ...]
    """What differed around the policies, one phrase each."""
    left_out: int
    """Finished episodes of common tasks that only one run has, where the tests are paired."""
    tests: tuple[Test, ...]
    """Row by row; rows that cannot be tested are left out."""

    @property
    def crosses_groups(self) -> bool:
        """Whether one of both is privileged and the other is not."""
        return self.a.group is not self.b.group

    def test(self, row: Row) -> Test | None:
        """The test of a row, if there is one."""
        return next((test for test in self.tests if test.row is row), None)

    def winner(self, row: Row) -> str:
        """Key of the run that is better in a row; empty if nobody can tell."""
        test = self.test(row)
        return "" if test is None else {1: self.a.key, -1: self.b.key, 0: ""}[test.better]

    def loser(self, row: Row) -> str:
        """Key of the other one; empty if nobody can tell."""
        winner = self.winner(row)
        return winner and (self.b.key if winner == self.a.key else self.a.key)

    def of(self, kind: Kind) -> tuple[Test, ...]:
        """The tests of rows of a kind."""
        return tuple(test for test in self.tests if test.row.kind is kind)


def compare_pair(a: Entrant, b: Entrant, rows: Sequence[Row]) -> Pair | None:
    """Test two runs against each other.

    The tests are paired if both share episodes in every task that they have in common; episodes
    that only one of them has are left out then. Otherwise they are about two samples.

    Args:
        a: The first run.
        b: The second one.
        rows: Rows of the table.

    Returns:
        What the tests say; None if one of both was measured elsewhere.
    """
    if not (a.run and b.run):
        return None
    objection = obstacle(a.run, b.run)
    tasks = [] if objection else [task.id for task in common_tasks(a, b)]
    if not tasks:
        objection = objection or "They have no finished task in common."
    shared = {task: same_episodes(a.records(task), b.records(task)) for task in tasks}
    paired = bool(tasks) and all(shared.values())
    tests = [
        _paired(row, [shared[task.id] for task in row.tasks]) if paired else _unpaired(row, a, b)
        for row in rows
        if all(task.id in shared for task in row.tasks)
    ]
    played = sum(len(one.records(task)) for one in (a, b) for task in tasks)
    return Pair(
        a=a,
        b=b,
        paired=paired,
        obstacle=objection,
        conditions=tuple(differing_conditions(a.run, b.run)),
        left_out=played - 2 * sum(map(len, shared.values())) if paired else 0,
        tests=_adjusted([test for test in tests if test]),
    )


def _paired(row: Row, shared: Sequence[Pairs]) -> Test:
    """Tests about the same episodes."""
    pairs = list(chain.from_iterable(shared))
    only_a = sum(a.success and not b.success for a, b in pairs)
    only_b = sum(b.success and not a.success for a, b in pairs)
    stages = [_stages(a, row) - _stages(b, row) for a, b in pairs]
    p, progress_p = mcnemar(only_a, only_b), paired_permutation(stages)
    return Test(
        row=row,
        episodes=(len(pairs), len(pairs)),
        successes=(sum(a.success for a, _ in pairs), sum(b.success for _, b in pairs)),
        only=(only_a, only_b),
        interval=tango_interval(only_a, only_b, len(pairs)),
        p=p,
        adjusted=p,
        progress=math.fsum(stages) / len(pairs) / _scale(row),
        progress_p=progress_p,
        progress_adjusted=progress_p,
    )


def _unpaired(row: Row, a: Entrant, b: Entrant) -> Test | None:
    """Tests about two samples; None where tasks do not have the same share of either."""
    counts = [(len(a.records(task.id)), len(b.records(task.id))) for task in row.tasks]
    if len({n / m for n, m in counts}) > 1:
        return None
    ours, theirs = ([r for task in row.tasks for r in one.records(task.id)] for one in (a, b))
    episodes = len(ours), len(theirs)
    successes = sum(r.success for r in ours), sum(r.success for r in theirs)
    stages = [_stages(r, row) for r in ours], [_stages(r, row) for r in theirs]
    means = [math.fsum(each) / len(each) / _scale(row) for each in stages]
    p, progress_p = barnard(successes, episodes), permutation(*stages)
    return Test(
        row=row,
        episodes=episodes,
        successes=successes,
        only=None,
        interval=newcombe_interval(successes, episodes),
        p=p,
        adjusted=p,
        progress=means[0] - means[1],
        progress_p=progress_p,
        progress_adjusted=progress_p,
    )


def _adjusted(tests: Sequence[Test]) -> tuple[Test, ...]:
    """The tests with p-values after Holm, and with the number of episodes that would tell."""
    done: dict[Row, Test] = {}
    for kind in Kind:
        family = [test for test in tests if test.row.kind is kind]
        adjusted = holm([test.p for test in family])
        progress = holm([test.progress_p for test in family])
        for test, p, progress_p in zip(family, adjusted, progress, strict=True):
            changed = replace(test, adjusted=p, progress_adjusted=progress_p)
            more = _more_episodes(changed, len(family))
            done[test.row] = replace(changed, more_episodes=more)
    return tuple(done[test.row] for test in tests)


def _more_episodes(test: Test, family: int) -> int | None:
    """Episodes that are missing at the strictest level that Holm asks of one of so many tests."""
    if test.better or test.only is None:
        return None
    played = test.episodes[0]
    needed = episodes_needed(*test.only, played, level=LEVEL / family)
    return None if needed is None else max(1, needed - played)


def _scale(row: Row) -> int:
    """What makes stages of tasks with different numbers of stages whole numbers of one size."""
    return math.lcm(*(task.max_stage for task in row.tasks))


def _stages(record: EpisodeRecord, row: Row) -> int:
    """Final progress as a whole number."""
    return record.final_stage * _scale(row) // record.max_stage


def _sign(value: float) -> int:
    return (value > 0) - (value < 0)
