"""Two runs against each other: which episodes are the same, and every test, row by row."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from duobench.results.entrants import Entrant, Group, RowKind, TableRow
from duobench.results.records import EpisodeRecord, SampledLayout
from duobench.results.scores import RunPart
from duobench.results.statistics import (
    LEVEL,
    any_time,
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
from duobench.results.suite import TaskInfo, execute_text, latency_text
from duobench.world.looks.look import Look

Pairs = list[tuple[EpisodeRecord, EpisodeRecord]]

_DIGITS = 6  # layouts are compared in micrometres: another processor may have another last bit
_CONDITIONS = ("look", "horizon", "instructions", "split", "speed_fraction", "control_rate_hz")
"""What of a configuration is not the policy's choice."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Test:
    """What tests say about two runs in one row of the table; differences are first minus second."""

    row: TableRow
    episodes: tuple[int, int]
    """Episodes of either run that were tested."""
    successes: tuple[int, int]
    only: tuple[int, int] | None = None
    """Episodes that only one of both solved; None if the episodes are not the same."""
    interval: tuple[float, float]
    """95 % interval of the difference of success rates."""
    p: float
    """Of the test of success."""
    adjusted: float = 1.0
    """The same after Holm, over the rows of this kind."""
    any_time: float = 1.0
    """P-value of success that holds at every look; 1 if the episodes are not the same."""
    any_time_adjusted: float = 1.0
    """The same after Holm, over the rows of this kind."""
    any_time_episodes: int = 0
    """Episodes that it counts, up to a gap."""
    progress: float
    """Difference of mean final progress."""
    progress_p: float
    """Of the permutation test of final progress."""
    progress_adjusted: float = 1.0
    """The same after Holm, over the rows of this kind."""
    more_episodes: int | None = None
    """About how many more would show the difference that was seen; None where that is unknown."""

    @property
    def rates(self) -> tuple[float, float]:
        """Success rates of the tested episodes."""
        return self.successes[0] / self.episodes[0], self.successes[1] / self.episodes[1]

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
        return int(np.sign(self.difference)) if self.adjusted <= LEVEL else 0

    @property
    def is_any_time(self) -> bool:
        """Whether a difference of success is claimed at every look."""
        return self.any_time_adjusted <= LEVEL

    @property
    def further(self) -> int:
        """1 if the first run has more progress, -1 if the second has, 0 if nobody can tell."""
        return int(np.sign(self.progress)) if self.progress_adjusted <= LEVEL else 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Pair:
    """Two runs against each other."""

    a: Entrant
    b: Entrant
    paired: bool
    obstacle: str | None
    """Why nothing is tested, if nothing is."""
    conditions: tuple[str, ...]
    """What differed around the policies, one phrase each."""
    left_out: int
    """Finished episodes of common tasks that only one run has, where the tests are paired."""
    tests: tuple[Test, ...]
    is_same: bool = False
    """Whether the records of all episodes that both have are equal: it is one run, or a copy."""

    @property
    def crosses_groups(self) -> bool:
        """Whether one of both is privileged and the other is not."""
        return self.a.group is not self.b.group

    def order(self, row: TableRow) -> tuple[str, str] | None:
        """Keys of the two in a row, the better one first; None if nobody can tell."""
        better = sum(test.better for test in self.tests if test.row is row)
        a, b = self.a.key, self.b.key
        return {1: (a, b), -1: (b, a)}.get(better)

    def of(self, kind: RowKind) -> tuple[Test, ...]:
        """The tests of rows of a kind."""
        return tuple(test for test in self.tests if test.row.kind is kind)


def compare_pair(a: Entrant, b: Entrant, rows: Sequence[TableRow]) -> Pair | None:
    """Test two runs against each other, row by row of a table.

    The tests are paired if both share episodes in every task that they have in common; episodes
    that only one of them has are left out then. Otherwise they are about two samples.

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
        objection = f"They played different suites ({suites}), whose scores cannot be compared."
    elif not tasks:
        objection = "They have no finished task in common."
    shared = {task: _same_episodes(a.records(task), b.records(task)) for task in tasks}
    paired = bool(shared) and all(shared.values())
    tests = [
        _paired(row, [pair for task in row.tasks for pair in shared[task.id]], _whole(row, a, b))
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
        is_same=paired and all(one == other for pairs in shared.values() for one, other in pairs),
        left_out=played - 2 * sum(map(len, shared.values())) if paired else 0,
        tests=_adjusted([test for test in tests if test], _planned(a, b)),
    )


def _whole(row: TableRow, a: Entrant, b: Entrant) -> range:
    """Indices whose episodes both have finished, up to the first that is missing.

    Runs that go on only append to them, which an any-time p-value relies on: no episode that
    comes late goes in between, and a sum waits for every task that will be a part of it.
    """
    whole = [task for task in _planned(a, b) if row.category in {"", task.category}]
    tasks = row.tasks if row.kind is RowKind.TASK else whole
    played = [{r.episode for r in one.records(task.id)} for one in (a, b) for task in tasks]
    first = max(one.part.suite.first_episode for one in (a, b) if one.part)
    return range(first, next(i for i in count(first) if not all(i in each for each in played)))


def _paired(row: TableRow, pairs: Pairs, whole: range) -> Test:
    only_a = Counter(a.episode for a, b in pairs if a.success and not b.success)
    only_b = Counter(b.episode for a, b in pairs if b.success and not a.success)
    only = only_a.total(), only_b.total()
    stages = [_stages(a, row) - _stages(b, row) for a, b in pairs]
    return Test(
        row=row,
        episodes=(len(pairs), len(pairs)),
        successes=(sum(a.success for a, _ in pairs), sum(b.success for _, b in pairs)),
        only=only,
        interval=tango_interval(*only, len(pairs)),
        p=mcnemar(*only),
        any_time=any_time((only_a[index], only_b[index]) for index in whole),
        any_time_episodes=sum(a.episode in whole for a, _ in pairs),
        progress=math.fsum(stages) / len(pairs) / _scale(row),
        progress_p=paired_permutation(stages),
    )


def _unpaired(row: TableRow, a: Entrant, b: Entrant) -> Test | None:
    """Tests about two samples; None where tasks do not have the same share of either."""
    if len({len(a.records(task.id)) / len(b.records(task.id)) for task in row.tasks}) > 1:
        return None
    ours, theirs = ([r for task in row.tasks for r in one.records(task.id)] for one in (a, b))
    episodes = len(ours), len(theirs)
    successes = sum(r.success for r in ours), sum(r.success for r in theirs)
    stages = [_stages(r, row) for r in ours], [_stages(r, row) for r in theirs]
    means = [math.fsum(each) / len(each) / _scale(row) for each in stages]
    return Test(
        row=row,
        episodes=episodes,
        successes=successes,
        interval=newcombe_interval(successes, episodes),
        p=barnard(successes, episodes),
        progress=means[0] - means[1],
        progress_p=permutation(*stages),
    )


def _planned(a: Entrant, b: Entrant) -> list[TaskInfo]:
    """The tasks that both will have played in the end."""
    ours, theirs = (one.part.suite.tasks if one.part else () for one in (a, b))
    return [task for task in ours if task.id in {other.id for other in theirs}]


def _adjusted(tests: Sequence[Test], planned: Sequence[TaskInfo]) -> tuple[Test, ...]:
    """The tests with p-values after Holm (any-time: planned tasks), and how many would tell."""
    several = [n for n in Counter(task.category for task in planned).values() if n > 1]
    sizes = {RowKind.TASK: len(planned), RowKind.CATEGORY: len(several), RowKind.OVERALL: 1}
    done: dict[TableRow, Test] = {}
    for kind in RowKind:
        family = [test for test in tests if test.row.kind is kind]
        adjusted = holm([test.p for test in family])
        progress = holm([test.progress_p for test in family])
        unplayed = [1.0] * (sizes[kind] - len(family))
        any_times = holm([test.any_time for test in family] + unplayed)
        for test, p, far, ever in zip(family, adjusted, progress, any_times, strict=False):
            changed = replace(test, adjusted=p, progress_adjusted=far, any_time_adjusted=ever)
            more = _more_episodes(changed, len(family))
            done[test.row] = replace(changed, more_episodes=more)
    return tuple(done[test.row] for test in tests)


def _more_episodes(test: Test, family: int) -> int | None:
    """Episodes that are missing at the strictest level that Holm asks of one of so many tests."""
    if test.better or test.only is None:
        return None
    played = test.episodes[0]
    needed = episodes_needed(*test.only, played, level=LEVEL / family)
    return needed and max(1, needed - played)


def _scale(row: TableRow) -> int:
    """What makes stages of tasks with different numbers of stages whole numbers of one size."""
    return math.lcm(*(task.max_stage for task in row.tasks))


def _stages(record: EpisodeRecord, row: TableRow) -> int:
    return record.final_stage * _scale(row) // record.max_stage


@dataclass(frozen=True, kw_only=True, slots=True)
class RunComparison:
    """What two or more policies are against each other."""

    entrants: tuple[Entrant, ...]
    """Column by column, group by group."""
    rows: tuple[TableRow, ...]
    pairs: tuple[Pair, ...]

    @property
    def groups(self) -> list[tuple[Group, list[Entrant]]]:
        """Every group that has a policy, with its policies."""
        each = [(group, [one for one in self.entrants if one.group is group]) for group in Group]
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


def _same_episodes(a: Sequence[EpisodeRecord], b: Sequence[EpisodeRecord]) -> Pairs:
    """The episodes of a task that both runs played, in pairs.

    Episodes are the same if suite version, task, split and seed are, which decide the layout, and
    if the layouts are, where both records have one. Looks, cameras and action modes may differ:
    they are part of what is compared.
    """
    theirs = {_identity(record): record for record in b}
    pairs = [(record, theirs[key]) for record in a if (key := _identity(record)) in theirs]
    return [(one, other) for one, other in pairs if _same_layout(one.layout, other.layout)]


def _identity(record: EpisodeRecord) -> tuple[str, str, str, int]:
    return record.suite_version, record.task, record.config.split, record.seed


def _same_layout(one: SampledLayout, other: SampledLayout) -> bool:
    return not (one and other) or _rounded(one) == _rounded(other)


def _rounded(layout: SampledLayout) -> object:
    poses = layout.get("poses", {}).items()
    return {**layout, "poses": {name: [round(x, _DIGITS) for x in pose] for name, pose in poses}}


def _differing_conditions(a: RunPart, b: RunPart) -> list[str]:
    """What was not the same around the two policies, one phrase each."""
    one, other = a.condition, b.condition
    found = [] if one.domain == other.domain else [f"domain {one.domain} and {other.domain}"]
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
    if a.suite.execution.latency != b.suite.execution.latency:
        found.append(f"{latency_text(a.suite)} and {latency_text(b.suite)}")
    if a.suite.execution.execute != b.suite.execution.execute:
        found.append(f"executed {execute_text(a.suite)} and {execute_text(b.suite)}")
    return found


def _named(value: object) -> str:
    return "one of its own" if isinstance(value, Look) else str(value)
