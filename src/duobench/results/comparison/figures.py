"""The figures of a comparison: stage bars task by task, and progress curves over each other.

Runs differ in colour and in dashes, so that neither alone is needed: the colours are apart for
people who are colour-blind, the dashes in print without colour.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from duobench.results.comparison.entrants import Entrant
from duobench.results.comparison.rows import Kind, Row
from duobench.results.figures import (
    CURVE,
    INK,
    TIME,
    WIDTH,
    frame_bars,
    progress_panels,
    stage_bar,
)
from duobench.results.metrics import TaskResult

COLOURS = (CURVE, "#d9822b", INK, "#9b6bb5", "#4f9d69")
"""Colours of the runs, which begin anew after the last."""
DASHES = ("solid", (0, (5, 1.5)), (0, (1, 1.2)), (0, (5, 1.5, 1, 1.5)), (0, (9, 2)), (0, (3, 3)))
"""Dashes of the runs, of another number than colours."""
_GAP = 0.5
"""Between the bars of two tasks, in bars."""


def stages(entrants: Sequence[Entrant], rows: Sequence[Row]) -> Figure:
    """One bar for each run in each task, with its letter."""
    bars: list[tuple[float, str, TaskResult]] = []
    titles: list[tuple[float, str]] = []
    at = 0.0
    for row in rows:
        if row.kind is not Kind.TASK:
            continue
        titles.append((at, row.label))
        for one in entrants:
            if result := _result(one, row):
                bars.append((at, one.key, result))
                at += 1
        at += _GAP
    figure = Figure(figsize=(WIDTH, 0.75 + 0.27 * at), layout="constrained")
    axes = figure.add_subplot()
    for place, _, result in bars:
        stage_bar(axes, place, result)
    axes.set_yticks([place for place, *_ in bars], [key for _, key, _ in bars], weight="bold")
    named = axes.secondary_yaxis(-0.035)
    named.set_yticks([place for place, _ in titles], [title for _, title in titles])
    named.tick_params(length=0)
    named.spines["left"].set_visible(False)
    axes.set_ylim(max(1.0, at - _GAP) - 0.5, -0.5)
    frame_bars(axes)
    return figure


def progress(entrants: Sequence[Entrant], rows: Sequence[Row]) -> Figure:
    """One panel a task, with a curve for each run, and the legend above."""
    tasks = [row for row in rows if row.kind is Kind.TASK]
    figure, panels = progress_panels([row.tasks[0] for row in tasks])
    runs = [one for one in entrants if one.results]
    lines = {one.key: _line(index, f"{one.key}  {one.title}") for index, one in enumerate(runs)}
    for axes, row in zip(panels, tasks, strict=True):
        for one in runs:
            if result := _result(one, row):
                line = lines[one.key]
                style = {"color": line.get_color(), "linestyle": line.get_linestyle()}
                axes.step(TIME, result.progress, where="post", linewidth=1.6, **style)
    columns = 1 if max(len(one.title) for one in runs) > _LONG_NAME else 3
    figure.legend(
        handles=[*lines.values()],
        loc="outside upper left",
        ncols=columns,
        frameon=False,
        handlelength=3.5,
    )
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + 0.2 * -(-len(runs) // columns))
    return figure


_LONG_NAME = 24
"""Letters of a name above which the legend has one name a line."""
FIGURES: Mapping[str, Callable[[Sequence[Entrant], Sequence[Row]], Figure]] = {
    "stages": stages,
    "progress": progress,
}
"""Every figure by its name."""


def _result(entrant: Entrant, row: Row) -> TaskResult | None:
    """What a run reached in a task; None if it has no finished episode of it."""
    found = entrant.results.tasks if entrant.results else ()
    task_id = row.tasks[0].id
    return next((one for one in found if one.task.id == task_id and one.records), None)


def _line(index: int, label: str) -> Line2D:
    colour, dashes = COLOURS[index % len(COLOURS)], DASHES[index % len(DASHES)]
    return Line2D([], [], color=colour, linestyle=dashes, linewidth=1.8, label=label)
