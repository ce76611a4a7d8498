"""Entrants of a comparison and its rows: conditions of runs, and published results.

Those of the paper, and of the checkpoints that its authors have published since, were measured
elsewhere, on their own implementation of the tasks: nothing is tested against them.
"""

from collections import Counter
from collections.abc import (
    Callable,
    Collection,
    Iterable,
    Mapping,
    Sequence,
)
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache
from importlib.resources import files
from itertools import chain
from pathlib import Path
from string import ascii_uppercase

import msgspec

from duobench.core.errors import EvaluationError, check_known
from duobench.results.bundle import read_source
from duobench.results.records import Key, Record
from duobench.results.scores import (
    RunPart,
    Score,
    TaskResult,
    group_by_condition,
    score,
    wilson_interval,
)
from duobench.results.suite import TaskInfo
from duobench.tasks.shifts.shift import NO_SHIFT, Shift

PAPER, AUTHORS = "paper", "authors"
"""Sources of published results: in the paper, and with its authors' checkpoints."""
SCHEMES = tuple(f"{name}:" for name in (PAPER, AUTHORS))
"""Prefixes of the names of their policies."""
WARNING = "measured elsewhere, on other tasks"
"""Words beside each of their numbers."""

Value = tuple[float, float]
"""Success rate in percent and mean final progress."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Mean:
    """A mean over some tasks, named by their ids, as the paper gives it."""

    tasks: frozenset[str]
    values: dict[str, Value]


@dataclass(frozen=True, kw_only=True, slots=True)
class PublishedResults:
    """A table of results in simulation."""

    name: str
    """`PAPER` or `AUTHORS`."""
    source: str
    rollouts: int
    policies: dict[str, str]
    """Names for people, by the name that follows `paper:`."""
    tasks: dict[str, dict[str, Value | int]]
    """Results by task id and policy: a rate with a progress, or successes."""
    means: dict[str, Mean] = field(default_factory=dict)
    """Means by category; `overall` is the mean over all tasks."""


@cache
def published(name: str) -> PublishedResults:
    """The table of `PAPER` or `AUTHORS`, from a file beside this module."""
    text = files("duobench.results").joinpath(f"{name}.toml").read_bytes()
    return msgspec.toml.decode(text, type=PublishedResults)


def check_policy(source: str) -> tuple[PublishedResults, str]:
    """The table that a name such as `paper:ACT` is of, and the policy in it."""
    tables: list[PublishedResults] = [published(name) for name in (PAPER, AUTHORS)]
    known = {
        f"{one.name}:{policy}": (one, policy)
        for one in tables
        for policy in one.policies
    }
    check_known("published policy", source, known)
    return known[source]


def value_of(
    results: PublishedResults, policy: str, tasks: Collection[str]
) -> Value | int | None:
    """Reported result of a policy on one task, or as the mean of exactly these tasks.

    Successes of several tasks add up, if those of each are there.
    """
    wanted = frozenset(tasks)
    values = [results.tasks.get(task, {}).get(policy) for task in wanted]
    if len(values) == 1:
        return values[0]
    counts = [value for value in values if isinstance(value, int)]
    if len(counts) == len(values):
        return sum(counts)
    means = (
        mean.values[policy] for mean in results.means.values() if mean.tasks == wanted
    )
    return next(means, None)


class Group(StrEnum):
    """Policies that may be compared with each other; the value is a heading."""

    UNPRIVILEGED = "Policies that are not privileged"
    PRIVILEGED = "Privileged policies"
    ELSEWHERE = "Measured elsewhere, on other tasks"

    @property
    def note(self) -> str:
        """The same in few words."""
        notes = {Group.UNPRIVILEGED: "not privileged", Group.PRIVILEGED: "privileged"}
        return notes.get(self, self.lower())


@dataclass(frozen=True, kw_only=True, slots=True)
class Cell:
    """Result of a policy on one task, or on several together."""

    episodes: int
    """Number of episodes; for a mean in the paper, of each task."""
    successes: int | None
    """Number of successes; None if only the rate is known."""
    rate: float
    interval: tuple[float, float] | None
    """95 % Wilson interval of it; None where only the rate is known."""
    progress: float | None
    """Mean final progress; None where it was not published."""

    @staticmethod
    def of(total: Score) -> "Cell":
        """The cell of at least one episode."""
        return Cell(
            episodes=total.episodes,
            successes=total.successes,
            rate=total.successes / total.episodes,
            interval=total.interval,
            progress=total.mean_final_progress or 0.0,
        )

    @staticmethod
    def quoted(source: str, tasks: Collection[str]) -> "Cell | None":
        """The cell of a published policy; None where nothing is reported."""
        results, policy = check_policy(source)
        value = value_of(results, policy, tasks)
        if value is None:
            return None
        if isinstance(value, int):
            trials = results.rollouts * len(tasks)
            return Cell(
                episodes=trials,
                successes=value,
                rate=value / trials,
                interval=wilson_interval(value, trials),
                progress=None,
            )
        percent, progress = value
        return Cell(
            episodes=results.rollouts,
            successes=None,
            rate=percent / 100,
            interval=None,
            progress=progress,
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class ReplayCheck:
    """Result of playing the records of a condition again."""

    verified: str = "not checked"
    """Result: "yes", "in part" (some records cannot be played again), "no" or "not checked"."""
    details: str = ""
    """Counts of verdicts, and the first problem."""


NOT_CHECKED = ReplayCheck()
Checker = Callable[[Path, Collection[Key]], Mapping[str, ReplayCheck]]
"""Play some records of a run or bundle again; a check for each condition, by its name."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Entrant:
    """A condition of a run, or a published policy."""

    title: str
    """Name for people, as given or that of the policy; others may have the same."""
    group: Group
    key: str = ""
    """Its letter: A, B, ..."""
    name: str = ""
    """Its title, with the letter if another one has the same."""
    part: RunPart | None = None
    """Played part of a run; None for a published policy."""
    quoted: str = ""
    """Name of a published policy: `paper:ACT`."""
    check: ReplayCheck = NOT_CHECKED
    """Whether its records were verified."""

    def records(self, task_id: str) -> tuple[Record, ...]:
        """The finished episodes of a task, by index; none if it was not played."""
        found = self.result(task_id)
        return found.records if found else ()

    def result(self, task_id: str) -> TaskResult | None:
        """Result in a task; None if it has no finished episode of it."""
        return self.part.results.played(task_id) if self.part else None

    def score(self, tasks: Sequence[TaskInfo]) -> Score | None:
        """Score on tasks together; None if it did not play all of them here."""
        played = [self.records(task.id) for task in tasks]
        return score("", list(chain.from_iterable(played))) if all(played) else None

    def cell(self, tasks: Sequence[TaskInfo]) -> Cell | None:
        """The same, or what was published of it; None where neither is known."""
        if self.part is None:
            return Cell.quoted(self.quoted, [task.id for task in tasks])
        found = self.score(tasks)
        return found and Cell.of(found)


def read_entrants(
    sources: Sequence[str], checker: Checker | None = None
) -> tuple[Entrant, ...]:
    """Read what is to be compared, group by group in the order given.

    Args:
        sources: Each what `read_named` takes, or a published policy (`paper:ACT`). All conditions
            of a run are compared.
        checker: Verifies the records of each run; without it they are not checked.
    """
    return lettered(
        [entrant for source in sources for entrant in _read(source, checker)]
    )


def sources_of(entrants: Iterable[Entrant]) -> list[str]:
    """Sources of the numbers of published policies, each once."""
    quoted = (check_policy(one.quoted)[0] for one in entrants if one.quoted)
    return list(dict.fromkeys(results.source for results in quoted))


def lettered(read: Sequence[Entrant]) -> tuple[Entrant, ...]:
    """Entrants group by group, each with its letter."""
    if not 1 < len(read) <= len(ascii_uppercase):
        raise EvaluationError(
            f"A comparison takes 2 to {len(ascii_uppercase)} runs, got {len(read)}."
        )
    if not any(entrant.part for entrant in read):
        raise EvaluationError(
            "A comparison needs a run; published results stand beside one."
        )
    sorted_by_group = [one for group in Group for one in read if one.group is group]
    titles = Counter(entrant.title for entrant in read)
    return tuple(
        replace(
            one,
            key=key,
            name=f"{one.title} ({key})" if titles[one.title] > 1 else one.title,
        )
        for key, one in zip(ascii_uppercase, sorted_by_group, strict=False)
    )


def _read(source: str, checker: Checker | None) -> list[Entrant]:
    if source.startswith(SCHEMES):
        results, policy = check_policy(source)
        title = f"{results.policies[policy]} [{results.name}]"
        return [Entrant(title=title, group=Group.ELSEWHERE, quoted=source)]
    name, parts = read_named(source)
    checks: Mapping[str, ReplayCheck] = {}
    if checker is not None:
        keys = [record.key for part in parts for record in part.records]
        checks = checker(split_name(source)[1], keys)
    return [
        replace(
            entrant_of(part, name if len(parts) == 1 else ""),
            check=checks.get(part.condition.name, NOT_CHECKED),
        )
        for part in parts
    ]


def entrant_of(part: RunPart, name: str = "") -> Entrant:
    """Entrant of a played condition, without a letter yet.

    Its name for people is that of the policy by default, with its shift if it has one.
    """
    if not part.results.overall.episodes:
        raise EvaluationError(
            f"{part.condition.name} has no finished episode to compare."
        )
    shift = "" if part.condition.shift == NO_SHIFT else f", {part.condition.shift}"
    return Entrant(
        title=name or f"{part.candidate.name}{shift}",
        group=Group.PRIVILEGED if part.candidate.privileged else Group.UNPRIVILEGED,
        part=part,
    )


def read_named(source: str) -> tuple[str, list[RunPart]]:
    """The name that a run is given, if any, and what was played under each of its conditions.

    Args:
        source: The folder of a run or a bundle, alone or as NAME=FOLDER. FOLDER@SHIFT takes the
            conditions with one shift alone, such as `runs/act@look-3` or `runs/act@none`.
    """
    name, path, shift = split_name(source)
    parts = group_by_condition(*read_source(path))
    if shift is not None:
        parts = [part for part in parts if part.condition.shift == shift]
        if not parts:
            raise EvaluationError(f"{path} was not played with {shift}.")
    return name, parts


def split_name(source: str) -> tuple[str, Path, Shift | None]:
    """Split a source into its name (or ""), its path, and its shift, if it has one."""
    name, is_named, path = source.partition("=")
    if not (is_named and name and path) or Path(source).exists():
        name, path = "", source
    folder, is_chosen, shift = path.rpartition("@")
    if is_chosen and folder and not Path(path).exists():
        return name, Path(folder), Shift.parse(shift)
    return name, Path(path), None


class RowKind(StrEnum):
    """Kind of a row; the tests of one kind are a family, over which Holm adjusts."""

    TASK = "task"
    CATEGORY = "category"
    OVERALL = "overall"


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class TableRow:
    """A row of the table."""

    kind: RowKind
    label: str
    """Title of the task, name of the category, or which tasks."""
    tasks: tuple[TaskInfo, ...]
    """Tasks that are added up in it; of several, those that every run has."""

    @property
    def category(self) -> str:
        """The category of its tasks; empty for the row of all tasks."""
        return "" if self.kind is RowKind.OVERALL else self.tasks[0].category


def table_rows(entrants: Sequence[Entrant]) -> tuple[TableRow, ...]:
    """Rows for all tasks that a run has, in the order of the runs.

    A category or all tasks have a row of their own where every run has at least two of them.
    """
    parts = [entrant.part for entrant in entrants if entrant.part]
    played = [one.task for part in parts for one in part.results.tasks if one.records]
    by_id: dict[str, TaskInfo] = {}
    for task in played:
        by_id.setdefault(task.id, task)
    tasks = list(by_id.values())
    common = [
        task for task in tasks if all(part.results.played(task.id) for part in parts)
    ]
    rows: list[TableRow] = []
    for category in dict.fromkeys(task.category for task in tasks):
        members = [task for task in tasks if task.category == category]
        rows += [
            TableRow(kind=RowKind.TASK, label=task.title, tasks=(task,))
            for task in members
        ]
        rows += _sum(RowKind.CATEGORY, category, members, common)
    return (*rows, *_sum(RowKind.OVERALL, "All tasks", tasks, common))


def sections(rows: Sequence[TableRow]) -> list[tuple[str, list[TableRow]]]:
    """Rows by category; those of all tasks have none."""
    names = dict.fromkeys(row.category for row in rows)
    return [(name, [row for row in rows if row.category == name]) for name in names]


def _sum(
    kind: RowKind, label: str, members: Sequence[TaskInfo], common: Sequence[TaskInfo]
) -> list[TableRow]:
    shared = [task for task in members if task in common]
    if len(shared) < 2:  # noqa: PLR2004 - a single one has a row already
        return []
    if len(shared) < len(members):
        whole = kind is RowKind.OVERALL
        label = (
            f"{len(shared)} common tasks"
            if whole
            else f"{label} ({len(shared)} common)"
        )
    return [TableRow(kind=kind, label=label, tasks=tuple(shared))]
