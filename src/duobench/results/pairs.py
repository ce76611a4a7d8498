"""Two runs against each other: which episodes are the same, and the numbers, row by row."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from duobench.results.entrants import (
    Entrant,
    Group,
    RowKind,
    TableRow,
)
from duobench.results.records import Record, SampledLayout
from duobench.results.scores import RunPart
from duobench.results.statistics import (
    LEVEL,
    episodes_that_would_tell,
    holm,
    mcnemar,
    newcombe_interval,
    tango_interval,
)
from duobench.results.suite import execute_text, extra_sensing, latency_text
from duobench.world.looks.look import Look

Pairs = list[tuple[Record, Record]]

_DIGITS = 6  # layouts are compared in micrometres: another processor may have another last bit
_CONDITIONS = (
    "look",
    "horizon",
    "instructions",
    "split",
    "speed_fraction",
    "gripper",
    "mount",
)
"""Parts of a configuration that are not the policy's choice."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Test:
    """Numbers of two runs in one row of the table; differences are first minus second."""

    row: TableRow
    episodes: tuple[int, int]
    """Episodes of either run that were compared."""
    successes: tuple[int, int]
    only: tuple[int, int] | None = None
    """Episodes that only one of both solved; None if the episodes are not the same."""
    interval: tuple[float, float]
    """95 % interval of the difference of success rates."""
    p: float | None = None
    """P-value of success; None if the episodes are not the same."""
    adjusted: float | None = None
    """The same after Holm, over the rows of this kind."""
    progress: float
    """Difference of mean final progress."""
    more_episodes: int | None = None
    """Episodes that would tell; None where the test tells, or that is unknown."""

    @property
    def difference(self) -> float:
        """Difference of success rates."""
        ours, theirs = self.successes
        return ours / self.episodes[0] - theirs / self.episodes[1]

    @property
    def better(self) -> int:
        """1 if the first run solves more, -1 if the second does, 0 if the test does not tell."""
        if self.adjusted is None or self.adjusted > LEVEL:
            return 0
        return 1 if self.difference > 0 else -1


@dataclass(frozen=True, kw_only=True, slots=True)
class Pair:
    """Two runs against each other."""

    a: Entrant
    b: Entrant
    paired: bool
    obstacle: str | None
    """Reason why nothing is tested, if so."""
    conditions: tuple[str, ...]
    """Differences around the policies, one phrase each."""
    left_out: int
    """Finished episodes of common tasks that only one run has, where the tests are paired."""
    tests: tuple[Test, ...]
    """Row by row of a table."""
    is_same: bool = False
    """Whether the records of all episodes that both have are equal: it is one run, or a copy."""

    @property
    def crosses_groups(self) -> bool:
        """Whether one of both is privileged and the other is not."""
        return self.a.group is not self.b.group

    def order(self, row: TableRow) -> tuple[str, str] | None:
        """Keys of the two policies, the better one first; None if the test cannot tell."""
        better = sum(test.better for test in self.tests if test.row is row)
        a, b = self.a.key, self.b.key
        return {1: (a, b), -1: (b, a)}.get(better)

    def of(self, kind: RowKind) -> tuple[Test, ...]:
        """The tests of rows of a kind."""
        return tuple(test for test in self.tests if test.row.kind is kind)

    @property
    def won(self) -> tuple[int, int]:
        """Tasks in which the first, and in which the second run solves more."""
        better = [test.better for test in self.of(RowKind.TASK)]
        return better.count(1), better.count(-1)

    @property
    def whole(self) -> Test | None:
        """The test of all tasks together, or of the only one."""
        tasks = self.of(RowKind.TASK)
        tests = self.of(RowKind.OVERALL) or (tasks if len(tasks) == 1 else ())
        return tests[0] if tests else None


def compare_pair(
    a: Entrant,
    b: Entrant,
    rows: Sequence[TableRow],
) -> Pair | None:
    """Compare two runs with each other, row by row of a table.

    They are tested if both share episodes in every task that they have in common; episodes that
    only one of them has are left out then. Otherwise they are two samples, whose difference has an
    interval and no test.

    Returns:
        What the tests say; None if one of both was measured elsewhere.
    """
    if not (a.part and b.part):
        return None
    objection = None
    tasks = _common_tasks(a.part, b.part)
    version, other = a.part.suite.version, b.part.suite.version
    if version != other:
        tasks = []
        suites = f"{version} and {other}"
        objection = (
            f"They played different suites ({suites}), whose scores cannot be compared."
        )
    elif not tasks:
        objection = "They have no finished task in common."
    shared = {task: _same_episodes(a.records(task), b.records(task)) for task in tasks}
    paired = bool(shared) and all(shared.values())
    tests = [
        _paired(row, [pair for task in row.tasks for pair in shared[task.id]])
        if paired
        else _unpaired(row, a, b)
        for row in rows
        if all(task.id in shared for task in row.tasks)
    ]
    played = sum(len(one.records(task)) for one in (a, b) for task in shared)
    return Pair(
        a=a,
        b=b,
        paired=paired,
        obstacle=objection,
        conditions=tuple(_differing_conditions(a.part, b.part)),
        is_same=paired
        and all(one == other for pairs in shared.values() for one, other in pairs),
        left_out=played - 2 * sum(map(len, shared.values())) if paired else 0,
        tests=_adjusted([test for test in tests if test]),
    )


def _paired(row: TableRow, pairs: Pairs) -> Test:
    only = (
        sum(a.success and not b.success for a, b in pairs),
        sum(b.success and not a.success for a, b in pairs),
    )
    gained = math.fsum(a.progress - b.progress for a, b in pairs)
    return Test(
        row=row,
        episodes=(len(pairs), len(pairs)),
        successes=(sum(a.success for a, _ in pairs), sum(b.success for _, b in pairs)),
        only=only,
        interval=tango_interval(*only, len(pairs)),
        p=mcnemar(*only),
        progress=gained / len(pairs),
    )


def _unpaired(
    row: TableRow,
    a: Entrant,
    b: Entrant,
) -> Test | None:
    """Numbers of two samples; None where tasks do not have the same share of either."""
    shares = {len(a.records(task.id)) / len(b.records(task.id)) for task in row.tasks}
    if len(shares) > 1:
        return None
    ours = [record for task in row.tasks for record in a.records(task.id)]
    theirs = [record for task in row.tasks for record in b.records(task.id)]
    episodes = len(ours), len(theirs)
    successes = sum(one.success for one in ours), sum(one.success for one in theirs)
    progress = [
        math.fsum(one.progress for one in each) / len(each) for each in (ours, theirs)
    ]
    return Test(
        row=row,
        episodes=episodes,
        successes=successes,
        interval=newcombe_interval(successes, episodes),
        progress=progress[0] - progress[1],
    )


def _adjusted(tests: Sequence[Test]) -> tuple[Test, ...]:
    """The tests with p-values after Holm, and the episodes that would tell."""
    done: dict[TableRow, Test] = {}
    for kind in RowKind:
        family = [test for test in tests if test.row.kind is kind]
        adjusted = holm([test.p for test in family if test.p is not None])
        for test, p in zip(family, adjusted or [None] * len(family), strict=True):
            changed = replace(test, adjusted=p)
            more = _more_episodes(changed, len(family))
            done[test.row] = replace(changed, more_episodes=more)
    return tuple(done[test.row] for test in tests)


def _more_episodes(test: Test, family: int) -> int | None:
    """Episodes that would tell at the strictest level that Holm asks of one of so many tests."""
    if test.better or test.only is None:
        return None
    return episodes_that_would_tell(*test.only, test.episodes[0], level=LEVEL / family)


@dataclass(frozen=True, kw_only=True, slots=True)
class RunComparison:
    """Comparison of two or more policies."""

    entrants: tuple[Entrant, ...]
    """Column by column, group by group."""
    rows: tuple[TableRow, ...]
    pairs: tuple[Pair, ...]

    @property
    def groups(self) -> list[tuple[Group, list[Entrant]]]:
        """Every group that has a policy, with its policies."""
        each = [
            (group, [one for one in self.entrants if one.group is group])
            for group in Group
        ]
        return [(group, members) for group, members in each if members]

    def is_best(self, row: TableRow, entrant: Entrant) -> bool:
        """Whether tests say that a policy is better than every other of its group."""
        others = [
            one
            for one in self.entrants
            if one.group is entrant.group and one is not entrant and one.cell(row.tasks)
        ]
        orders = {pair.order(row) for pair in self.pairs}
        return bool(others) and all((entrant.key, one.key) in orders for one in others)


def _common_tasks(a: RunPart, b: RunPart) -> list[str]:
    """Tasks of which both have finished episodes, with the same stages and the same horizon."""
    theirs = {one.task.id: one.task for one in b.results.tasks if one.records}
    return [
        task.id
        for task in (one.task for one in a.results.tasks if one.records)
        if (other := theirs.get(task.id))
        and (task.stages, task.horizon) == (other.stages, other.horizon)
    ]


def _same_episodes(a: Sequence[Record], b: Sequence[Record]) -> Pairs:
    """The episodes of a task that both runs played, in pairs.

    Episodes are the same if suite version, task, split and seed are, which decide the layout, and
    if the layouts are, where both records have one. Looks, cameras and action modes may differ:
    they are part of what is compared.
    """
    theirs = {_identity(record): record for record in b}
    pairs = [
        (record, theirs[key]) for record in a if (key := _identity(record)) in theirs
    ]
    return [
        (one, other) for one, other in pairs if _same_layout(one.layout, other.layout)
    ]


def _identity(record: Record) -> tuple[str, str, str, int]:
    return record.suite_version, record.task, record.config.split, record.seed


def _same_layout(one: SampledLayout, other: SampledLayout) -> bool:
    return not (one and other) or _rounded(one) == _rounded(other)


def _rounded(layout: SampledLayout) -> object:
    poses = layout.get("poses", {}).items()
    return {
        **layout,
        "poses": {name: [round(x, _DIGITS) for x in pose] for name, pose in poses},
    }


def _differing_conditions(a: RunPart, b: RunPart) -> list[str]:
    """Differences around the two policies, one phrase each."""
    one, other = a.condition, b.condition
    found = (
        []
        if one.domain == other.domain
        else [f"domain {one.domain} and {other.domain}"]
    )
    if a.run.is_real and b.run.is_real and a.run.rig != b.run.rig:
        found.append("another rig")
    if one.shift != other.shift:
        found.append(f"shift {one.shift} and {other.shift}")
    found += [
        f"{name.replace('_', ' ')} {_named(ours)} and {_named(theirs)}"
        for name in _CONDITIONS
        if (ours := getattr(a.candidate.config, name))
        != (theirs := getattr(b.candidate.config, name))
    ]
    sensing = [extra_sensing(each.candidate.config) for each in (a, b)]
    if sensing[0] != sensing[1]:
        found.append(
            f"seen beyond the robot's images {' and '.join(s or 'nothing' for s in sensing)}"
        )
    if a.suite.execution.latency != b.suite.execution.latency:
        found.append(f"{latency_text(a.suite)} and {latency_text(b.suite)}")
    if a.suite.execution.execute != b.suite.execution.execute:
        found.append(f"executed {execute_text(a.suite)} and {execute_text(b.suite)}")
    return found


def _named(value: object) -> str:
    return "one of its own" if isinstance(value, Look) else str(value)
