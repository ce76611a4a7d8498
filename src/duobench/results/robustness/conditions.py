"""The conditions of a suite that was played under shifts: a folder for each, named as its shift."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from duobench.errors import EvaluationError
from duobench.results.metrics import Results, Score, TaskResult, summarize
from duobench.results.reader import DESCRIPTION, RunReader
from duobench.results.run import Run
from duobench.results.source import open_source
from duobench.results.suites.merged import shards_in
from duobench.shifts.shift import AXES, LEVELS, NO_SHIFT, Shift, every_shift


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Condition:
    """What a policy reached under one shift."""

    run: Run
    """The run."""
    results: Results
    """What its records add up to."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Robustness:
    """What a policy reached under shifts."""

    title: str
    """Name of the policy, or the one that was given."""
    conditions: Mapping[Shift, Condition]
    """What was played, in the order of `every_shift`; at least one condition."""

    @property
    def run(self) -> Run:
        """One of the runs, for what all have in common."""
        return next(iter(self.conditions.values())).run

    @property
    def axes(self) -> list[str]:
        """The axes that were played."""
        played = {shift.axis for shift in self.conditions}
        return [axis for axis in AXES if axis in played]

    @property
    def missing(self) -> int:
        """Episodes of its runs that have no record."""
        sizes = [(one.run.size, one.results.overall.episodes) for one in self.conditions.values()]
        return sum(size - there for size, there in sizes)

    def score(self, axis: str, level: int) -> Score | None:
        """What was reached along an axis at a level from 0 to 5; None if nothing was played."""
        found = self._at(axis, level)
        return found.results.overall if found and found.results.overall.episodes else None

    def task(self, axis: str, level: int, task_id: str) -> TaskResult | None:
        """The same of one task."""
        found = self._at(axis, level)
        tasks = found.results.tasks if found else ()
        return next((one for one in tasks if one.task.id == task_id and one.records), None)

    def levels(self, axis: str) -> list[int]:
        """The levels of an axis that were played, 0 included if no shift was."""
        return [level for level in range(LEVELS + 1) if self.score(axis, level)]

    def _at(self, axis: str, level: int) -> Condition | None:
        return self.conditions.get(Shift(axis=axis, level=level) if level else NO_SHIFT)


def conditions_in(path: Path) -> dict[Shift, Path]:
    """Folders of conditions in a folder that is no run itself; none if there are none."""
    if not path.is_dir() or (path / DESCRIPTION).exists():
        return {}
    folders = {shift: path / shift.name for shift in every_shift()}
    return {
        shift: folder
        for shift, folder in folders.items()
        if (folder / DESCRIPTION).exists() or shards_in(folder)
    }


def open_conditions(path: Path) -> dict[Shift, RunReader]:
    """What reads each condition in a folder.

    Raises:
        EvaluationError: There is none, or shards of one are missing.
    """
    found = conditions_in(path)
    if not found:
        raise EvaluationError(f"{path} holds no conditions of a suite that is played under shifts.")
    return {shift: open_source(folder) for shift, folder in found.items()}


def read_robustness(path: Path, title: str = "") -> Robustness:
    """What a policy reached under the shifts in a folder.

    Args:
        path: The folder.
        title: Name for people; the policy's by default.

    Raises:
        EvaluationError: There is nothing, a folder holds another condition than its name says, or
            they are not of one policy and suite.
        FileError: A record cannot be read.
    """
    conditions: dict[Shift, Condition] = {}
    first: Run | None = None
    for shift, reader in open_conditions(path).items():
        run = reader.read_run()
        if run.suite.shift != shift:
            raise EvaluationError(f"{reader.path} holds episodes with {run.suite.shift}.")
        plain = replace(run.under(NO_SHIFT), command="")
        first = first or plain
        if differing := first.differences(plain) or plain.differences(first):
            raise EvaluationError(
                f"{reader.path} is of another evaluation than the folders beside it: "
                f"{'; '.join(differing)}."
            )
        conditions[shift] = Condition(
            run=run, results=summarize(run.suite.tasks, reader.read_records(run))
        )
    if first is None:
        raise AssertionError("There is a condition.")
    return Robustness(title=title or first.title, conditions=conditions)
