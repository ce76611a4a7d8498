"""What is compared: runs, and policies of the paper beside them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from string import ascii_uppercase

from duobench.errors import EvaluationError
from duobench.results.comparison import paper
from duobench.results.metrics import Results, score, summarize
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.source import read_source
from duobench.results.suite import TaskInfo


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
    """Success rate 0..1."""
    interval: tuple[float, float] | None
    """95 % Wilson interval of it; None for what was measured elsewhere."""
    progress: float
    """Mean final progress."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Entrant:
    """A run, or a policy of the paper."""

    title: str
    """Name for people, as given or that of the policy; others may have the same."""
    group: Group
    """What it may be compared with."""
    key: str = ""
    """Its letter: A, B, ..."""
    name: str = ""
    """Its title, with the letter if another one has the same."""
    run: Run | None = None
    """The run; None for a policy of the paper."""
    results: Results | None = None
    """What the run's records add up to; None for a policy of the paper."""
    quoted: str = ""
    """Name in the paper's table, if it stands there."""

    def records(self, task_id: str) -> tuple[EpisodeRecord, ...]:
        """The finished episodes of a task, by index; none if it was not played."""
        tasks = self.results.tasks if self.results else ()
        return next((one.records for one in tasks if one.task.id == task_id), ())

    def cell(self, tasks: Sequence[TaskInfo]) -> Cell | None:
        """What it reached on tasks together; None if it did not play all of them."""
        ids = [task.id for task in tasks]
        if self.results is None:
            return _quoted(self.quoted, ids)
        played = [self.records(task_id) for task_id in ids]
        if not all(played):
            return None
        total = score("", [record for records in played for record in records])
        return Cell(
            episodes=total.episodes,
            successes=total.successes,
            rate=total.successes / total.episodes,
            interval=total.interval,
            progress=total.mean_final_progress or 0.0,
        )


def _quoted(policy: str, ids: Sequence[str]) -> Cell | None:
    if (value := paper.value_of(policy, ids)) is None:
        return None
    percent, progress = value
    return Cell(
        episodes=paper.paper_results().rollouts,
        successes=None,
        rate=percent / 100,
        interval=None,
        progress=progress,
    )


def read_entrants(sources: Sequence[str]) -> tuple[Entrant, ...]:
    """Read what is to be compared.

    Args:
        sources: Each what `read_source` takes, the same after a name and `=` (`small=runs/x`), or
            a policy of the paper (`paper:ACT`).

    Returns:
        One entrant each, group by group, in the order given.

    Raises:
        EvaluationError: There are too few or too many, none is a run, one has no episode, or
            there is no run.
        UnknownNameError: The paper has no such policy.
        FileError: A record cannot be read.
    """
    if not 1 < len(sources) <= len(ascii_uppercase):
        raise EvaluationError(
            f"A comparison takes 2 to {len(ascii_uppercase)} runs, got {len(sources)}."
        )
    read = [_read(source) for source in sources]
    if not any(entrant.run for entrant in read):
        raise EvaluationError("A comparison needs a run; the paper's results stand beside one.")
    sorted_by_group = [one for group in Group for one in read if one.group is group]
    titles = Counter(entrant.title for entrant in read)
    return tuple(
        replace(one, key=key, name=f"{one.title} ({key})" if titles[one.title] > 1 else one.title)
        for key, one in zip(ascii_uppercase, sorted_by_group, strict=False)
    )


def _read(source: str) -> Entrant:
    """An entrant that has no letter yet."""
    if source.startswith(paper.SCHEME):
        policy = paper.check_policy(source)
        title = f"{paper.paper_results().policies[policy]} [paper]"
        return Entrant(title=title, group=Group.ELSEWHERE, quoted=policy)
    name, path = split_name(source)
    run, records = read_source(path)
    if not records:
        raise EvaluationError(f"{path} has no finished episode to compare.")
    return Entrant(
        title=name or run.policy,
        group=Group.PRIVILEGED if run.privileged else Group.UNPRIVILEGED,
        run=run,
        results=summarize(run.suite.tasks, records),
    )


def split_name(source: str) -> tuple[str, Path]:
    """The name, empty if there is none, and the path of a source."""
    name, is_named, path = source.partition("=")
    if is_named and name and path and not Path(source).exists():
        return name, Path(path)
    return "", Path(source)
