"""What is compared, and in which rows: conditions of runs, and policies of the paper.

The paper's results were measured elsewhere, on its own implementation of the tasks: nothing is
tested against them.
"""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from importlib.resources import files
from itertools import chain
from pathlib import Path
from string import ascii_uppercase

import msgspec

from duobench.errors import EvaluationError, check_known
from duobench.results.bundle import read_source
from duobench.results.records import EpisodeRecord
from duobench.results.scores import RunPart, Score, TaskResult, group_by_condition, score
from duobench.results.suite import TaskInfo
from duobench.shifts.shift import NO_SHIFT, Shift

SCHEME = "paper:"
"""What the name of one of its policies begins with."""
WARNING = "measured elsewhere, on other tasks"
"""What stands beside each of its numbers."""

Value = tuple[float, float]
"""Success rate in percent and mean final progress."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Mean:
    """A mean over some tasks, named by their ids, as the paper gives it."""

    tasks: frozenset[str]
    values: dict[str, Value]


@dataclass(frozen=True, kw_only=True, slots=True)
class PaperResults:
    """The table of the results in simulation."""

    source: str
    rollouts: int
    policies: dict[str, str]
    """Names for people, by the name that follows `paper:`."""
    tasks: dict[str, dict[str, Value]]
    """By id of the task and by policy."""
    means: dict[str, Mean]
    """By category; `overall` is the one over all tasks."""


@cache
def paper_results() -> PaperResults:
    """The table, from the file beside this module."""
    text = files("duobench.results").joinpath("paper.toml").read_bytes()
    return msgspec.toml.decode(text, type=PaperResults)


def check_policy(source: str) -> str:
    """The name of a policy without `paper:`."""
    known = [f"{SCHEME}{name}" for name in paper_results().policies]
    check_known("policy of the paper", source, known)
    return source.removeprefix(SCHEME)


def value_of(policy: str, tasks: Collection[str]) -> Value | None:
    """What the paper reports for a policy on one task, or as the mean of exactly these tasks."""
    results: PaperResults = paper_results()
    if len(tasks) == 1:
        (task,) = tasks
        return results.tasks.get(task, {}).get(policy)
    wanted = frozenset(tasks)
    means = (mean.values[policy] for mean in results.means.values() if mean.tasks == wanted)
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
    """What a policy reached on one task, or on several together."""

    episodes: int
    """How many; of a mean in the paper, of each task."""
    successes: int | None
    """How many succeeded; None where only the rate is known."""
    rate: float
    interval: tuple[float, float] | None
    """95 % Wilson interval of it; None for what was measured elsewhere."""
    progress: float

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
    def quoted(percent: float, progress: float) -> "Cell":
        """The cell of numbers of the paper."""
        return Cell(
            episodes=paper_results().rollouts,
            successes=None,
            rate=percent / 100,
            interval=None,
            progress=progress,
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Entrant:
    """A condition of a run, or a policy of the paper."""

    title: str
    """Name for people, as given or that of the policy; others may have the same."""
    group: Group
    key: str = ""
    """Its letter: A, B, ..."""
    name: str = ""
    """Its title, with the letter if another one has the same."""
    part: RunPart | None = None
    """What was played; None for a policy of the paper."""
    quoted: str = ""
    """Name in the paper's table, if it stands there."""

    def records(self, task_id: str) -> tuple[EpisodeRecord, ...]:
        """The finished episodes of a task, by index; none if it was not played."""
        found = self.result(task_id)
        return found.records if found else ()

    def result(self, task_id: str) -> TaskResult | None:
        """What it reached in a task; None if it has no finished episode of it."""
        return self.part.results.played(task_id) if self.part else None

    def score(self, tasks: Sequence[TaskInfo]) -> Score | None:
        """What it reached on tasks together; None if it did not play all of them here."""
        played = [self.records(task.id) for task in tasks]
        return score("", list(chain.from_iterable(played))) if all(played) else None

    def cell(self, tasks: Sequence[TaskInfo]) -> Cell | None:
        """The same, or what the paper reports; None where neither is known."""
        if self.part is None:
            value = value_of(self.quoted, [task.id for task in tasks])
            return value and Cell.quoted(*value)
        found = self.score(tasks)
        return found and Cell.of(found)


def read_entrants(sources: Sequence[str]) -> tuple[Entrant, ...]:
    """Read what is to be compared, group by group in the order given.

    Args:
        sources: Each what `read_named` takes, or a policy of the paper (`paper:ACT`). All
            conditions of a run are compared.
    """
    return lettered([entrant for source in sources for entrant in _read(source)])


def lettered(read: Sequence[Entrant]) -> tuple[Entrant, ...]:
    """Entrants group by group, each with its letter."""
    if not 1 < len(read) <= len(ascii_uppercase):
        raise EvaluationError(
            f"A comparison takes 2 to {len(ascii_uppercase)} runs, got {len(read)}."
        )
    if not any(entrant.part for entrant in read):
        raise EvaluationError("A comparison needs a run; the paper's results stand beside one.")
    sorted_by_group = [one for group in Group for one in read if one.group is group]
    titles = Counter(entrant.title for entrant in read)
    return tuple(
        replace(one, key=key, name=f"{one.title} ({key})" if titles[one.title] > 1 else one.title)
        for key, one in zip(ascii_uppercase, sorted_by_group, strict=False)
    )


def _read(source: str) -> list[Entrant]:
    if source.startswith(SCHEME):
        policy = check_policy(source)
        title = f"{paper_results().policies[policy]} [paper]"
        return [Entrant(title=title, group=Group.ELSEWHERE, quoted=policy)]
    name, parts = read_named(source)
    return [entrant_of(part, name if len(parts) == 1 else "") for part in parts]


def entrant_of(part: RunPart, name: str = "") -> Entrant:
    """What was played under a condition as an entrant that has no letter yet.

    Its name for people is that of the policy by default, with its shift if it has one.
    """
    if not part.results.overall.episodes:
        raise EvaluationError(f"{part.condition.name} has no finished episode to compare.")
    shift = "" if part.condition.shift == NO_SHIFT else f", {part.condition.shift}"
    return Entrant(
        title=name or f"{part.condition.policy}{shift}",
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
    """The name, empty if there is none, the path, and the shift of a source, if it has one."""
    name, is_named, path = source.partition("=")
    if not (is_named and name and path) or Path(source).exists():
        name, path = "", source
    folder, is_chosen, shift = path.rpartition("@")
    if is_chosen and folder and not Path(path).exists():
        return name, Path(folder), Shift.parse(shift)
    return name, Path(path), None


class RowKind(StrEnum):
    """What a row is about; the tests of one kind are a family, over which Holm adjusts."""

    TASK = "task"
    CATEGORY = "category"
    OVERALL = "overall"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TableRow:
    """A row of the table."""

    kind: RowKind
    label: str
    """Title of the task, name of the category, or which tasks."""
    tasks: tuple[TaskInfo, ...]
    """What is added up in it; of several tasks, those that every run has."""

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
    common = [task for task in tasks if all(part.results.played(task.id) for part in parts)]
    rows: list[TableRow] = []
    for category in dict.fromkeys(task.category for task in tasks):
        members = [task for task in tasks if task.category == category]
        rows += [TableRow(kind=RowKind.TASK, label=task.title, tasks=(task,)) for task in members]
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
        label = f"{len(shared)} common tasks" if whole else f"{label} ({len(shared)} common)"
    return [TableRow(kind=kind, label=label, tasks=tuple(shared))]
