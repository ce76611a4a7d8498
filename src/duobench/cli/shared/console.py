"""Output of the commands."""

import os
import sys
from collections.abc import Sequence
from typing import Any

from rich import box
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Column, Table
from rich.text import Text

from duobench.results.scores import (
    FAR_OFF,
    RunPart,
    Score,
    TaskResult,
    interval_percent,
    percent,
    progress_text,
)

NOTEBOOK = {"JPY_PARENT_PID", "JPY_SESSION_NAME", "COLAB_RELEASE_TAG"}
"""Environment variables that Jupyter sets for what runs in its notebooks, one or the other."""
PLAIN_WIDTH = 130
"""Columns when the output goes to a file or another program, which never wraps."""


def console() -> Console:
    """Standard output: coloured and as wide as the terminal, or plain and of one width.

    Text is printed as it is: `[name]` and `:name:` come from people, not from us, and only a
    terminal breaks its lines. Notebooks run programs in what passes for a terminal, ask all of them
    for colours, and show what moves a cursor as signs: there, output is plain.
    """
    plain = NOTEBOOK & os.environ.keys() or not sys.stdout.isatty()
    out = Console(
        highlight=False,
        markup=False,
        emoji=False,
        soft_wrap=True,
        force_terminal=False if plain else None,
    )
    if not out.is_terminal:
        out.width = PLAIN_WIDTH
    return out


def say(*what: object, **options: Any) -> None:
    """Print to it."""
    console().print(*what, **options)


class _Uncut(Table):
    """A table that is rather wider than a terminal, which then breaks its lines, than cut."""

    def __rich_console__(
        self, console: Console, options: ConsoleOptions
    ) -> RenderResult:
        free = options.update(max_width=sys.maxsize)
        for column in self.columns:
            if column.no_wrap:
                cells = (column.header, *column.cells)
                column.min_width = max(
                    Measurement.get(console, free, c).maximum for c in cells
                )
        least = Measurement.get(console, free, self).minimum
        wide = options.update(max_width=max(options.max_width, least))
        return super().__rich_console__(console, wide)


def table(*columns: Column | str, **options: Any) -> Table:
    """A table without a frame."""
    return _Uncut(
        *columns,
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        **options,
    )


def whole(heading: str, **options: Any) -> Column:
    """A column whose cells are never broken into lines."""
    return Column(heading, no_wrap=True, **options)


def numeric(*headings: str) -> list[Column]:
    """Columns of numbers."""
    return [whole(heading, justify="right") for heading in headings]


def counted(count: int, noun: str) -> str:
    """A number and what it counts, such as "1 task" and "2 tasks"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def results_table(part: RunPart) -> Table:
    """One row a task, grouped by category, with a row a category and one for everything.

    The policy is named above the table.
    """
    results, expected = part.results, part.suite.episodes
    errors = ("Errors",) if results.overall.errors else ()
    headings = (
        "Episodes",
        *errors,
        "Success\n%",
        "95 %\ninterval",
        "Final\nprogress",
    )
    rows = table(
        whole("Task"),
        *numeric(*headings),
        "Episodes by\nlast stage",
        title=Text(part.candidate.title),
        title_justify="left",
        caption_justify="left",
    )
    legend = "Episodes by last stage: 2:5 says that five episodes came to stage 2 and no further."
    far_off = FAR_OFF if part.is_far_off else ""
    notes = (part.candidate.robot_note, far_off, part.repeatability, legend)
    rows.caption = "\n".join(filter(None, notes))

    def cells(
        name: str,
        score: Score,
        wanted: int,
    ) -> list[str]:
        """Cells of every row; a run that is not finished says how far it is."""
        episodes = (
            str(score.episodes)
            if score.episodes == wanted
            else f"{score.episodes}/{wanted}"
        )
        broken = [str(score.errors)] if errors else []
        return [
            name,
            episodes,
            *broken,
            percent(score.success_rate),
            interval_percent(score),
            progress_text(score.mean_final_progress),
        ]

    for category in results.categories:
        members = [one for one in results.tasks if one.task.category == category.label]
        for one in members:
            rows.add_row(*cells(one.task.id, one.score, expected), _stages(one))
        if len(members) > 1:
            rows.add_row(
                *cells(category.label, category, expected * len(members)),
                style="italic",
            )
        rows.add_section()
    rows.add_row(
        *cells(results.overall.label, results.overall, part.size), style="bold"
    )
    return rows


def verified_table(parts: Sequence[RunPart]) -> Table:
    """Table of verified scores: `results_table`, or one row a condition where there are several."""
    numbers = numeric("Successes", "%", "95 %\ninterval", "Final\nprogress")
    rows = table(whole("Condition"), *numbers)
    for part in parts:
        one, name = (
            part.results.overall,
            f"{part.candidate.title}, {part.condition.shift}",
        )
        numbers = (
            percent(one.success_rate),
            interval_percent(one),
            progress_text(one.mean_final_progress),
        )
        rows.add_row(name, f"{one.successes} of {one.episodes}", *numbers)
    rows = rows if len(parts) > 1 else results_table(parts[0])
    said = "Without what is contradicted; what is not verifiable reaches no stage."
    notes = filter(None, dict.fromkeys(part.repeatability for part in parts))
    rows.caption = "\n".join(
        [said, *(notes if len(parts) > 1 else [str(rows.caption or "")])]
    ).rstrip()
    return rows


def _stages(result: TaskResult) -> Text:
    """Counts by last stage, `stage:count`, the last stage bold."""
    text = Text()
    for stage, count in enumerate(result.last_stage_counts):
        style = (
            "dim" if count == 0 else "bold" if stage == result.task.max_stage else ""
        )
        text.append(f"{stage}:{count}  ", style=style)
    text.rstrip()
    return text


CHECK_STYLES = {"ok": "green", "note": "yellow", "failed": "bold red", "skipped": "dim"}
"""Style of what a doctor says, by outcome."""
