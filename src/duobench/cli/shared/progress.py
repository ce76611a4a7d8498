"""How far long work is: live bars on a terminal, few plain lines anywhere else."""

from __future__ import annotations

from collections import Counter
from collections.abc import (
    Callable,
    Iterator,
    Mapping,
    Sequence,
)
from contextlib import contextmanager
from datetime import timedelta
from time import monotonic
from typing import TYPE_CHECKING

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

from duobench.cli.shared.console import console, counted
from duobench.results.records import Record
from duobench.results.run import WHOLE, Run, Shard

if TYPE_CHECKING:
    from duobench.evaluation.runners.evaluations import Attempt

PLAIN_LINES = 10
"""About how many lines of progress are printed where nothing can be overwritten."""
PATIENCE = 60.0
"""Seconds after which a line is printed there however little is done, and again when twice as much
time is past as at the last line."""


class Display:
    """Bars that are updated in place, one for each name, or a few lines."""

    def __init__(
        self,
        console: Console,
        noun: str,
        progress: Progress,
    ) -> None:
        self._console = console
        self._noun = noun
        self._progress = progress
        self._bars: dict[str, TaskID] = {}
        self._successes: Counter[str] = Counter()
        self._total = self._done = self._earlier = 0
        self._start, self._due = progress.get_time(), PATIENCE

    def begin(self, heading: str, totals: Mapping[str, int]) -> None:
        """Say what is going to be done, or show the bars, which say it."""
        self._total = sum(totals.values())
        for name, total in totals.items():
            self._bars[name] = self._progress.add_task(
                name, total=total, successes="", start=False
            )
        self.say(heading)

    def advance(
        self,
        name: str,
        by: int = 1,
        *,
        succeeded: bool | None = None,
        earlier: bool = False,
    ) -> None:
        """Note what is done.

        Args:
            name: The bar.
            by: How many things are done.
            succeeded: Whether they succeeded, if that is counted.
            earlier: Whether they were done in an earlier call, about which no line is printed.
        """
        bar, before = self._bars[name], self._done
        self._done += by
        self._successes[name] += bool(succeeded)
        self._progress.start_task(bar)
        self._progress.update(bar, advance=by)
        successes = ""
        if succeeded is not None:
            self._progress.update(bar, successes=f"{self._successes[name]} succeeded")
            successes = f", {self._successes.total()} succeeded"
        self._earlier += by if earlier else 0
        tenths = [
            PLAIN_LINES * done // max(1, self._total) for done in (before, self._done)
        ]
        elapsed = self._progress.get_time() - self._start
        if not earlier and (tenths[0] != tenths[1] or elapsed >= self._due):
            self._due = max(PATIENCE, 2 * elapsed)
            times = self._times(elapsed)
            self.say(
                f"{self._done} of {counted(self._total, self._noun)}{successes}, {times}"
            )

    def _times(self, elapsed: float) -> str:
        """How long it has taken, and how long the rest takes at the same speed."""
        past, here = timedelta(seconds=round(elapsed)), self._done - self._earlier
        if not here or self._done >= self._total:
            return f"{past} elapsed"
        rest = timedelta(seconds=round(elapsed / here * (self._total - self._done)))
        return f"{past} elapsed, {rest} left"

    def tell(self, done: int, total: int) -> None:
        """Show that so many of so many things are done; those of the first call were before."""
        is_first = not self._bars
        if is_first:
            self.begin(f"{done} of {counted(total, self._noun)}", {self._noun: total})
        self.advance(self._noun, done - self._done, earlier=is_first)

    def say(self, line: str) -> None:
        """Print a line, if there are no bars; a report will say it then."""
        if self._progress.disable:
            self._console.print(line)


@contextmanager
def display(
    noun: str, screen: Console | None = None, clock: Callable[[], float] = monotonic
) -> Iterator[Display]:
    """Progress that suits a console, live during the block; `noun` is counted, as of 1."""
    screen = screen or console()
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[successes]}", style="dim"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    is_plain = not screen.is_terminal
    with Progress(
        *columns, console=screen, get_time=clock, disable=is_plain
    ) as progress:
        yield Display(screen, noun, progress)


class EpisodesPlayed:
    """The progress of an evaluation, or of a shard of it."""

    def __init__(self, shown: Display, shard: Shard = WHOLE) -> None:
        self._shown, self._shard = shown, shard

    def on_run_start(self, run: Run, finished: Sequence[Record]) -> None:
        """Say what is going to be done, and what was finished earlier."""
        suite, totals = run.suite, run.counts(self._shard)
        going_on = f", {len(finished)} already finished" if finished else ""
        heading = (
            f"Policy {run.candidate.title}: {counted(len(suite.tasks), 'task')}, "
            f"{counted(sum(totals.values()), 'episode')}{going_on}"
        )
        self._shown.begin(f"{heading}\n{run.candidate.robot_note}".rstrip(), totals)
        for record in finished:
            self._shown.advance(record.task, succeeded=record.success, earlier=True)

    def on_episode(self, played: Record) -> None:
        """Count an episode, and say with what error it failed."""
        if played.error:
            name = f"{played.task}, episode {played.episode}"
            self._shown.say(f"{name} failed with an error: {played.reason}")
        self._shown.advance(played.task, succeeded=played.success)


class EpisodesKept:
    """The progress of recording: episodes that are kept."""

    def __init__(self, shown: Display) -> None:
        self._shown = shown

    def on_run_start(self, run: Run, finished: Sequence[Attempt]) -> None:
        """Say what is going to be done, and what was kept earlier."""
        totals = {task.id: run.suite.episodes for task in run.suite.tasks}
        kept = [
            attempt.task
            for attempt in finished
            if attempt.kept and attempt.task in totals
        ]
        heading = (
            f"{counted(len(totals), 'task')}, {counted(run.suite.size, 'episode')}"
        )
        heading += f", {len(kept)} already recorded" if kept else ""
        self._shown.begin(f"{heading}\n{run.candidate.robot_note}".rstrip(), totals)
        for task in kept:
            self._shown.advance(task, earlier=True)

    def on_episode(self, played: Attempt) -> None:
        """Count the episode, if it is kept."""
        self._shown.advance(played.task, int(played.kept))
