"""How far long work is: live bars on a terminal, few plain lines anywhere else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
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
from duobench.evaluation.records import EpisodeRecord
from duobench.evaluation.suite import Run, TaskInfo

PLAIN_LINES = 10
"""About how many lines of progress are printed where nothing can be drawn over."""


class Bars:
    """A bar for each name, with successes if they are counted, redrawn in place."""

    def __init__(self, progress: Progress) -> None:
        """Draw into a display that is already live."""
        self._progress = progress
        self._bars: dict[str, TaskID] = {}
        self._successes: Counter[str] = Counter()

    def begin(self, heading: str, totals: Mapping[str, int]) -> None:  # noqa: ARG002 - bars say it
        """Draw the bars."""
        for name, total in totals.items():
            self._bars[name] = self._progress.add_task(name, total=total, told="", start=False)

    def advance(
        self,
        name: str,
        by: int = 1,
        *,
        succeeded: bool | None = None,
        earlier: bool = False,  # noqa: ARG002 - bars show all alike
    ) -> None:
        """Advance a bar."""
        bar = self._bars[name]
        self._progress.start_task(bar)
        self._progress.update(bar, advance=by)
        if succeeded is not None:
            self._successes[name] += succeeded
            self._progress.update(bar, told=f"{self._successes[name]} succeeded")

    def say(self, line: str) -> None:
        """A report will say it."""


class Lines:
    """A line whenever another tenth of everything is done."""

    def __init__(self, console: Console, noun: str) -> None:
        """Print to a console that is no terminal; what is counted is called `noun`, as of one."""
        self._console, self._noun = console, noun
        self._total = self._done = self._successes = 0

    def begin(self, heading: str, totals: Mapping[str, int]) -> None:
        """Say what is going to be done."""
        self._total = sum(totals.values())
        self.say(heading)

    def advance(
        self,
        name: str,  # noqa: ARG002 - lines are about everything
        by: int = 1,
        *,
        succeeded: bool | None = None,
        earlier: bool = False,
    ) -> None:
        """Print a line whenever another tenth is done; what was done earlier only counts."""
        before, self._done = self._done, self._done + by
        self._successes += bool(succeeded)
        tenths = [PLAIN_LINES * done // max(1, self._total) for done in (before, self._done)]
        if not earlier and tenths[0] != tenths[1]:
            told = "" if succeeded is None else f", {self._successes} succeeded"
            self.say(f"{self._done} of {counted(self._total, self._noun)}{told}")

    def say(self, line: str) -> None:
        """Print a line."""
        self._console.print(line, soft_wrap=True)


@contextmanager
def display(console: Console, noun: str) -> Iterator[Bars | Lines]:
    """What suits a console, live as long as the block lasts.

    Args:
        console: Where to show it.
        noun: What is counted, as of one.
    """
    if not console.is_terminal:
        yield Lines(console, noun)
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[told]}", style="dim"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        yield Bars(progress)


class EpisodesPlayed:
    """The progress of an evaluation."""

    def __init__(self, shown: Bars | Lines) -> None:
        """Show it in a display."""
        self._shown = shown

    def on_run_start(self, run: Run, finished: Sequence[EpisodeRecord]) -> None:
        """Say what is going to be done, and what was finished earlier."""
        suite = run.suite
        going_on = f", {len(finished)} already finished" if finished else ""
        heading = (
            f"Policy {run.policy}: {counted(len(suite.tasks), 'task')}, "
            f"{counted(suite.size, 'episode')}{going_on}"
        )
        self._shown.begin(heading, {task.id: suite.episodes for task in suite.tasks})
        for record in finished:
            self._shown.advance(record.task, succeeded=record.success, earlier=True)

    def on_record(self, record: EpisodeRecord) -> None:
        """Count an episode, and say why it broke off."""
        if record.error:
            self._shown.say(f"{record.task}, episode {record.episode} broke off: {record.reason}")
        self._shown.advance(record.task, succeeded=record.success)


class EpisodesKept:
    """The progress of recording: episodes that are kept."""

    def __init__(self, shown: Bars | Lines) -> None:
        """Show it in a display."""
        self._shown = shown

    def on_start(self, tasks: Sequence[TaskInfo], wanted: int, attempts: Sequence[Attempt]) -> None:
        """Say what is going to be done, and what was kept earlier."""
        totals = {task.id: wanted for task in tasks}
        kept = [attempt.task for attempt in attempts if attempt.kept and attempt.task in totals]
        heading = f"{counted(len(tasks), 'task')}, {counted(sum(totals.values()), 'episode')}"
        heading += f", {len(kept)} already recorded" if kept else ""
        self._shown.begin(heading, totals)
        for task in kept:
            self._shown.advance(task, earlier=True)

    def on_attempt(self, attempt: Attempt) -> None:
        """Count the episode, if it is kept."""
        self._shown.advance(attempt.task, int(attempt.kept))


@contextmanager
def counting(console: Console, noun: str) -> Iterator[Callable[[int, int], None]]:
    """What shows how many of how many things are done, as long as the block lasts.

    Args:
        console: Where to show it.
        noun: What is counted, as of one.

    Yields:
        A function of the number that is done and the number of all.
    """
    with display(console, noun) as shown:
        before: int | None = None

        def tell(done: int, total: int) -> None:
            nonlocal before
            if before is None:
                shown.begin(f"{done} of {counted(total, noun)}", {noun: total})
            shown.advance(noun, done - (before or 0), earlier=before is None)
            before = done

        yield tell
