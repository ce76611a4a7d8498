"""The rows of the table: tasks, category by category, and what they add up to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from duobench.results.comparison.entrants import Entrant
from duobench.results.suite import TaskInfo


class Kind(StrEnum):
    """What a row is about; the tests of one kind are a family, over which Holm adjusts."""

    TASK = "task"
    CATEGORY = "category"
    OVERALL = "overall"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Row:
    """A row of the table."""

    kind: Kind
    """What it is about."""
    label: str
    """Title of the task, name of the category, or which tasks."""
    tasks: tuple[TaskInfo, ...]
    """What is added up in it; of several tasks, those that every run has."""


def table_rows(entrants: Sequence[Entrant]) -> tuple[Row, ...]:
    """Rows for all tasks that a run has, in the order of the runs.

    A category or all tasks have a row of their own where every run has at least two of them.
    """
    runs = [entrant for entrant in entrants if entrant.results]
    tasks: dict[str, TaskInfo] = {}
    for run in runs:
        for one in run.results.tasks if run.results else ():
            if one.records:
                tasks.setdefault(one.task.id, one.task)
    common = [task for task in tasks.values() if all(run.records(task.id) for run in runs)]
    rows = []
    for category in dict.fromkeys(task.category for task in tasks.values()):
        members = [task for task in tasks.values() if task.category == category]
        rows += [Row(kind=Kind.TASK, label=task.title, tasks=(task,)) for task in members]
        rows += _sum(Kind.CATEGORY, category, members, common)
    return (*rows, *_sum(Kind.OVERALL, "All tasks", list(tasks.values()), common))


def category_of(row: Row) -> str:
    """The category of a row's tasks; empty for the row of all tasks."""
    return "" if row.kind is Kind.OVERALL else row.tasks[0].category


def sections(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    """Rows by category; those of all tasks have none."""
    names = dict.fromkeys(category_of(row) for row in rows)
    return [(name, [row for row in rows if category_of(row) == name]) for name in names]


def _sum(
    kind: Kind, label: str, members: Sequence[TaskInfo], common: Sequence[TaskInfo]
) -> list[Row]:
    shared = [task for task in members if task in common]
    if len(shared) < 2:  # noqa: PLR2004 - a single one has a row already
        return []
    if len(shared) < len(members):
        whole = kind is Kind.OVERALL
        label = f"{len(shared)} common tasks" if whole else f"{label} ({len(shared)} common)"
    return [Row(kind=kind, label=label, tasks=tuple(shared))]
