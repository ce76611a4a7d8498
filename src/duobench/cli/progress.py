"""How far an evaluation is: a live bar on a terminal, few plain lines anywhere else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from duobench.cli.console import counted
from duobench.evaluation.demonstrations import Attempt
from duobench.evaluation.evaluate import Observer
from duobench.evaluation.records import EpisodeRecord
from duobench.evaluation.suite import Run, TaskInfo

PLAIN_LINES = 10
"""About how many lines of progress a run prints where nothing can be drawn over."""


class LiveProgress:
    """A bar a task, with successes so far, redrawn in place."""

    def __init__(self, progress: Progress) -> None:
        """Draw into a display that is already live."""
        self._progress = progress
        self._bars: dict[str, TaskID] = {}
        self._successes: Counter[str] = Counter()

    def on_run_start(self, run: Run, finished: Sequence[EpisodeRecord]) -> None:
        """Draw the bars, with what was finished earlier."""
        for task in run.suite.tasks:
            self._bars[task.id] = self._progress.add_task(
                task.id, total=run.suite.episodes, successes=0, start=False
            )
        for record in finished:
            self.on_record(record)

    def on_record(self, record: EpisodeRecord) -> None:
        """Advance the bar of the episode's task."""
        bar = self._bars[record.task]
        self._successes[record.task] += record.success
        self._progress.start_task(bar)
        self._progress.update(bar, advance=1, successes=self._successes[record.task])


class PlainProgress:
    """A line now and then, and one for every episode that broke off."""

    def __init__(self, console: Console) -> None:
        """Print to a console that is no terminal."""
        self._console = console
        self._total = self._done = self._successes = 0

    def on_run_start(self, run: Run, finished: Sequence[EpisodeRecord]) -> None:
        """Say what is going to be done."""
        self._total = run.suite.size
        self._done = len(finished)
        self._successes = sum(record.success for record in finished)
        going_on = f", {self._done} already finished" if finished else ""
        self._console.print(
            f"Policy {run.policy}: {counted(len(run.suite.tasks), 'task')}, "
            f"{counted(self._total, 'episode')}{going_on}",
            soft_wrap=True,
        )

    def on_record(self, record: EpisodeRecord) -> None:
        """Print a line whenever another tenth is done."""
        self._done += 1
        self._successes += record.success
        if record.error:
            self._console.print(
                f"{record.task}, episode {record.episode} broke off: {record.reason}",
                soft_wrap=True,
            )
        tenths, before = (PLAIN_LINES * n // self._total for n in (self._done, self._done - 1))
        if tenths != before:
            self._console.print(
                f"{self._done} of {counted(self._total, 'episode')}, {self._successes} succeeded"
            )


@contextmanager
def progress_display(console: Console) -> Iterator[Observer]:
    """The observer that suits a console, live as long as the block lasts."""
    if not console.is_terminal:
        yield PlainProgress(console)
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[successes]} succeeded", style="dim"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        yield LiveProgress(progress)


@contextmanager
def counting(console: Console, noun: str) -> Iterator[Callable[[int, int], None]]:
    """What shows how many of how many things are done, as long as the block lasts.

    Args:
        console: Where to show it.
        noun: What is counted, in the plural.

    Yields:
        A function of the number that is done and the number of all.
    """
    shown = -1

    def tell(done: int, total: int) -> None:
        nonlocal shown
        tenth = PLAIN_LINES * done // max(1, total)
        if tenth != shown:
            console.print(f"{done} of {total} {noun}")
        shown = tenth

    if not console.is_terminal:
        yield tell
        return
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(TextColumn("{task.description}"), *columns, console=console) as progress:
        bar = progress.add_task(noun, total=None)
        yield lambda done, total: progress.update(bar, completed=done, total=total)


class AttemptBars:
    """A bar a task, of the episodes that are kept; for recording."""

    def __init__(self, progress: Progress) -> None:
        """Draw into a display that is already live."""
        self._progress = progress
        self._bars: dict[str, TaskID] = {}

    def on_start(self, tasks: Sequence[TaskInfo], wanted: int, attempts: Sequence[Attempt]) -> None:
        """Draw the bars, with what was kept earlier."""
        for task in tasks:
            self._bars[task.id] = self._progress.add_task(task.id, total=wanted, start=False)
        for attempt in attempts:
            self.on_attempt(attempt)

    def on_attempt(self, attempt: Attempt) -> None:
        """Advance the bar of the task, if the episode is kept."""
        bar = self._bars.get(attempt.task)
        if bar is not None:
            self._progress.start_task(bar)
            self._progress.update(bar, advance=int(attempt.kept))


class AttemptLines:
    """A line whenever another tenth is kept; for recording."""

    def __init__(self, console: Console) -> None:
        """Print to a console that is no terminal."""
        self._console = console
        self._total = self._kept = 0

    def on_start(self, tasks: Sequence[TaskInfo], wanted: int, attempts: Sequence[Attempt]) -> None:
        """Say what is going to be done."""
        self._total = wanted * len(tasks)
        self._kept = sum(attempt.kept for attempt in attempts)
        self._console.print(
            f"{counted(len(tasks), 'task')}, {counted(self._total, 'episode')}"
            + (f", {self._kept} already recorded" if self._kept else "")
        )

    def on_attempt(self, attempt: Attempt) -> None:
        """Print a line whenever another tenth is done."""
        before, self._kept = self._kept, self._kept + attempt.kept
        if PLAIN_LINES * before // self._total != PLAIN_LINES * self._kept // self._total:
            self._console.print(f"{self._kept} of {counted(self._total, 'episode')}")


@contextmanager
def bars(console: Console) -> Iterator[AttemptBars | AttemptLines]:
    """The observer of a recording that suits a console, live as long as the block lasts."""
    if not console.is_terminal:
        yield AttemptLines(console)
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        yield AttemptBars(progress)
