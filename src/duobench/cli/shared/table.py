"""The results as a table for a terminal."""

from __future__ import annotations

from rich import box
from rich.table import Table
from rich.text import Text

from duobench.results.scores import (
    RunPart,
    Score,
    TaskResult,
    interval_percent,
    percent,
    progress_text,
)


def results_table(part: RunPart) -> Table:
    """One row a task, grouped by category, with a row a category and one for everything.

    Args:
        part: What was played under one condition, by which policy, which is named above the table.

    Returns:
        A table that rich prints.
    """
    results, expected = part.results, part.suite.episodes
    table = Table(
        title=Text(part.candidate.title), box=box.SIMPLE_HEAD, pad_edge=False, title_justify="left"
    )
    table.add_column("Task", no_wrap=True)
    errors = ("Errors",) if results.overall.errors else ()
    overtime = part.suite.overtime
    late = (f"Within {overtime:g}\nhorizons %",) if overtime > 1 else ()
    if late:
        table.caption = f"Within {overtime:g} horizons is no score: scores end at the horizon."
    headings = ("Episodes", *errors, "Success\n%", "95 %\ninterval", "Final\nprogress", *late)
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("Episodes by\nlast stage")
    for category in results.categories:
        members = [one for one in results.tasks if one.task.category == category.label]
        for one in members:
            cells = _cells(one.task.id, one.score, expected, bool(errors), bool(late))
            table.add_row(*cells, _stages(one))
        if len(members) > 1:
            of_all = expected * len(members)
            cells = _cells(category.label, category, of_all, bool(errors), bool(late))
            table.add_row(*cells, style="italic")
        table.add_section()
    cells = _cells(results.overall.label, results.overall, part.size, bool(errors), bool(late))
    table.add_row(*cells, style="bold")
    return table


def _cells(name: str, score: Score, expected: int, with_errors: bool, with_late: bool) -> list[str]:
    """The cells that every row has; a run that is not finished says how far it is."""
    episodes = str(score.episodes) if score.episodes == expected else f"{score.episodes}/{expected}"
    errors = [str(score.errors)] if with_errors else []
    rate = percent(score.success_rate)
    late = [percent(score.late_rate)] if with_late else []
    return [name, episodes, *errors, rate, interval_percent(score), progress_text(score), *late]


def _stages(result: TaskResult) -> Text:
    """Counts by last stage, `stage:count`, the last stage bold."""
    text = Text()
    for stage, count in enumerate(result.last_stage_counts):
        style = "dim" if count == 0 else "bold" if stage == result.task.max_stage else ""
        text.append(f"{stage}:{count}  ", style=style)
    text.rstrip()
    return text
