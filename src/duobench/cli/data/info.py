"""`duobench data info`: what a data set adds up to."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import tyro
from rich.table import Table

from duobench.cli.shared.advice import FOREIGN, advising
from duobench.cli.shared.console import (
    numeric,
    say,
    table,
    whole,
)
from duobench.cli.shared.folders import AS_NOTED, open_data
from duobench.data.used_rows import Reason

if TYPE_CHECKING:
    from duobench.data.summary import Summary, TaskSummary


def run(
    data: tyro.conf.Positional[Path], images: bool = True, import_tasks: bool = False
) -> None:
    """Show what a data set adds up to, and write a page about it into its folder.

    Args:
        data: Folder of the data set.
        images: Show images of each task on the page, which takes a moment.
        import_tasks: Import tasks that are not of the benchmark, which runs the code of the modules
            that the data set names.
    """
    source = open_data(data, import_tasks=import_tasks)
    from duobench.data import summarize, write_page

    with advising(FOREIGN):
        summary = summarize(source)
    columns = numeric("Episodes", "Successes", "Frames", "Median", "99 %", "Horizon")
    rows = table(whole("Task"), *columns)
    for task in summary.tasks:
        middle, long = f"{task.median_length:g}", f"{task.long_length:.0f}"
        numbers = (
            task.episodes,
            task.successes,
            task.frames,
            middle,
            long,
            task.horizon,
        )
        rows.add_row(task.task, *map(str, numbers))
    rows.add_section()
    overall = (summary.episodes, summary.successes, summary.frames)
    rows.add_row("All tasks", *map(str, overall), style="bold")
    rows.caption = (
        "Frames: all control steps, 30 a second. Median, 99 %: steps until success, or until "
        "the end without it."
    )
    say(rows)
    say(_smoothness(summary))
    say(f"Episodes: {summary.domains}")
    if summary.left_out:
        say(f"Frames missing in videos, left out by a late encoder: {summary.left_out}")
    if summary.leading:
        say(_leading(summary))
    for line in _actors(summary):
        say(line)
    for task, words in summary.differences.items():
        say(f"{task}, {AS_NOTED}: {words}")
    say(f"Page: {write_page(source, summary, images=images)}")


def _actors(summary: Summary) -> Iterator[str]:
    """Actors, with the tasks where they were not the same in all."""
    actors: dict[str, list[TaskSummary]] = {}
    for task in summary.tasks:
        for actor in task.actors:
            actors.setdefault(actor, []).append(task)
    for actor, tasks in actors.items():
        where = (
            ""
            if len(tasks) == len(summary.tasks)
            else f" ({', '.join(t.task for t in tasks)})"
        )
        yield f"Recorded by {actor}{where}"
    for task in summary.tasks:
        if task.attempted:
            yield f"{task.task}: {task.attempted}"
        if task.led is not None:
            yield f"{task.task}: a hand led an arm in {task.led:.0%} of the steps"
        if task.corrected:
            yield f"{task.task}: {task.corrected}"
        yield from _unused(task)


def _leading(summary: Summary) -> Table:
    """Table of what operators have led, by task and device."""
    columns = numeric("Takes", "Successes", "Mean stage", "Led s a\nsuccess")
    rows = table(whole("Task"), "Operator", "Device", *columns)
    for led in summary.leading:
        seconds = "–" if led.led_s is None else f"{led.led_s:.1f}"
        numbers = (f"{led.begun}", f"{led.successes}", f"{led.stage:.1f}", seconds)
        rows.add_row(led.task, led.operator, led.device, *numbers)
    rows.caption = (
        "Takes: all that were begun, discarded ones too. Led: median, until success."
    )
    return rows


def _unused(task: TaskSummary) -> Iterator[str]:
    """Episodes and rows that are not used."""
    parts = {
        "not to be used": task.discarded,
        "without success though kept, which exports leave out": task.failures_led,
        "looked at again": task.reviewed,
    }
    words = [f"{count} {what}" for what, count in parts.items() if count]
    if words:
        yield f"{task.task}: {'; '.join(words)}"
    trimmed = task.unused.get(Reason.TRIMMED, 0)
    if trimmed:
        yield f"{task.task}: {trimmed} of {task.frames} rows were trimmed away"
    idle = task.unused.get(Reason.IDLE, 0)
    if idle:
        yield (
            f"{task.task}: nobody led and nothing moved in {idle} of {task.frames} rows, "
            "which exports leave out"
        )


def _smoothness(summary: Summary) -> Table:
    """Table of properties of joint targets that are hard to learn, task by task."""
    columns = numeric(
        "Steps at a\njoint limit", "Reversals\nan episode", "Steps with\na jump"
    )
    rows = table(whole("Task"), *columns)
    for task in summary.tasks:
        found = task.smoothness
        shares = f"{found.at_limit:.1%}", f"{found.reversals:.1f}", f"{found.jumps:.1%}"
        rows.add_row(task.task, *shares)
    return rows
