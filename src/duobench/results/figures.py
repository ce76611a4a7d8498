"""The figures of reports, as SVG whose bytes follow from the results alone.

Stages have the same colours in every figure and on every page. Stages are ordered, so their colours
are a ramp of rising lightness, from rust where nothing happened to sand just before the end;
success is blue, which no common form of colour blindness mixes up with either end of the ramp.
Wherever the colours appear, the stage's number does too.
"""

import io
import math
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from typing import Any, TypeVarTuple

import matplotlib.style
import numpy as np
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from duobench.results.scores import (
    TIME_POINTS,
    Results,
    Score,
    TaskResult,
    percent,
)
from duobench.results.suite import TaskInfo
from duobench.tasks.shifts.shift import ALL_AXES, LEVELS

Axes = Any
"""Axes of matplotlib, whose own types leave what styles a plot unknown; so do those of a figure."""
Values = TypeVarTuple("Values")
INK = "#1c2024"
CURVE = "#2a6f98"
"""Colour of curves."""
SUCCESS = "#2a6f97"
_RAMP = ((0x9B, 0x3A, 0x1E), (0xE0, 0x8A, 0x45), (0xF6, 0xDF, 0xB2))
"""Stops of the ramp for the stages before the last, evenly spaced, as RGB."""
_LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Shares of red, green and blue in relative luminance [WCAG 2.2, ITU-R BT.709]."""
_INK_CHANGE = 0.179
"""Relative luminance at which black and white text have the same contrast, sqrt(1.05 * 0.05) - 0.05
[WCAG 2.2]; at least one of them always has more than 4.5."""
_FAINT = "#8a9299"  # colour of grid lines, which works on a light and on a dark page
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "text.parse_math": False,  # a title with a dollar is no formula
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.facecolor": "none",
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
}
WIDTH = 7.6
"""Width of every figure in inches."""
MOST_COLUMNS = 4
"""Panels side by side."""
TIME = tuple(100 * point / (TIME_POINTS - 1) for point in range(TIME_POINTS))
"""Times of a progress curve in percent of the horizon."""
COLOURS = (CURVE, "#d9822b", INK, "#9b6bb5", "#4f9d69")
"""Colours of several runs, apart for people who are colour-blind; they begin anew after the
last."""
DASHES: tuple[Any, ...] = (
    "solid",
    (0, (5, 1.5)),
    (0, (1, 1.2)),
    (0, (5, 1.5, 1, 1.5)),
    (0, (9, 2)),
    (0, (3, 3)),
)
"""Dashes of several runs, of another number than colours."""
Levels = Mapping[str, Mapping[int, Score]]
"""Scores at each level of each axis."""
_GAP = 0.5  # between the bars of two tasks, in bars
_LONG_NAME = (
    27  # letters of a name, its key included, above which a legend has one name a line
)
_LONGEST_TITLE = 24  # letters that fit above the narrowest panel
_APART = 0.06  # between the markers of two runs at one level, in levels
_SHORTEST_LABELLED = 0.035
"""Share of a bar below which a segment is too short for its stage's number."""


def stage_colours(max_stage: int) -> tuple[str, ...]:
    """Colours of the stages 0, 1, ..., max_stage as `#rrggbb`."""
    stops = np.linspace(0, 1, len(_RAMP))
    shares = np.arange(max_stage) / max(1, max_stage - 1)
    channels = [
        np.rint(np.interp(shares, stops, channel))
        for channel in zip(*_RAMP, strict=True)
    ]
    return (*map(to_hex, np.transpose(channels) / 255), SUCCESS)


def ink_on(colour: str) -> str:
    """The text colour that is easier to read on a `#rrggbb` colour."""
    luminance = np.dot(_LUMINANCE, np.power(to_rgb(colour), 2.2))
    return "#000000" if luminance > _INK_CHANGE else "#ffffff"


def _figure(height: float) -> Any:
    """An empty figure of that height in inches."""
    return Figure(figsize=(WIDTH, height), layout="constrained")


def _short(title: str) -> str:
    """A title, cut where a figure has no room for it; the page around it has the whole."""
    return title if len(title) <= _LONGEST_TITLE else f"{title[: _LONGEST_TITLE - 1]}…"


def stage_bars(results: Results) -> Figure:
    """One bar a task: the shares of episodes by last stage, the success rate written beside it."""
    tasks = [one for one in results.tasks if one.score.episodes]
    figure = _figure(0.75 + 0.34 * len(tasks))
    bars = [(row, _short(one.task.title), one) for row, one in enumerate(tasks)]
    _plot_bars(figure.add_subplot(), bars, max(1, len(tasks)))
    return figure


def grouped_stage_bars(
    groups: Sequence[tuple[str, Sequence[tuple[str, TaskResult]]]],
) -> Figure:
    """One bar for each run in each titled task, with a word beside it."""
    titles: list[tuple[float, str]] = []
    bars: list[tuple[float, str, TaskResult]] = []
    at = 0.0
    for title, runs in groups:
        titles.append((at, title))
        bars += [
            (at + place, word, result) for place, (word, result) in enumerate(runs)
        ]
        at += len(runs) + _GAP
    figure = _figure(0.75 + 0.27 * at)
    axes = figure.add_subplot()
    _plot_bars(
        axes,
        bars,
        max(1.0, at - _GAP),
        weight="bold",
    )
    named = axes.secondary_yaxis(-0.035)
    named.set_yticks(
        [place for place, _ in titles], [_short(title) for _, title in titles]
    )
    named.tick_params(length=0)
    named.spines["left"].set_visible(False)
    return figure


def _plot_bars(
    axes: Axes, bars: Sequence[tuple[float, str, TaskResult]], end: float, **labels: str
) -> None:
    """Plot bars at their places along y up to an end, with the styled label of each beside it."""
    for place, _, result in bars:
        _plot_bar(axes, place, result)
    axes.set_yticks(
        [place for place, *_ in bars], [label for _, label, _ in bars], **labels
    )
    axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "25", "50", "75", "100 %"])
    what = "Share of episodes by last stage; success rate at the right"
    axes.set(xlim=(0.0, 1.09), ylim=(end - 0.5, -0.5), xlabel=what)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.spines["bottom"].set_bounds(0.0, 1.0)


def _plot_bar(
    axes: Axes,
    row: float,
    result: TaskResult,
) -> None:
    """Plot the segments of a task's bar, with the number of each stage, and the success rate."""
    left = 0.0
    colours = stage_colours(result.task.max_stage)
    for stage, count in enumerate(result.last_stage_counts):
        share = count / result.score.episodes
        if not count:
            continue
        colour = colours[stage]
        bar = axes.barh(
            row,
            share,
            left=left,
            height=0.68,
            color=colour,
            linewidth=0,
        )
        if left:
            axes.plot(
                [left, left], [row - 0.34, row + 0.34], color="white", linewidth=0.8
            )
        if share >= _SHORTEST_LABELLED:
            label = "✓" if stage == result.task.max_stage else str(stage)
            axes.bar_label(
                bar, [label], label_type="center", color=ink_on(colour), fontsize=8
            )
        left += share
    axes.annotate(
        f"{percent(result.score.success_rate)} %",
        (1.0, row),
        xytext=(6, 0),
        textcoords="offset points",
        va="center",
        weight="bold",
    )


def progress_over_time(results: Results) -> Figure:
    """One panel a task: the mean progress over the share of the horizon that has passed."""
    tasks = [one for one in results.tasks if one.score.episodes]
    figure, panels = _progress_panels([one.task for one in tasks])
    for axes, one in zip(panels, tasks, strict=True):
        axes.fill_between(
            TIME, one.progress, step="post", color=CURVE, alpha=0.25, linewidth=0
        )
        axes.step(
            TIME,
            one.progress,
            where="post",
            color=CURVE,
            linewidth=1.6,
        )
    return figure


def _progress_panels(tasks: Sequence[TaskInfo]) -> tuple[Any, list[Axes]]:
    """A figure with an empty panel for each task, for progress against `TIME`."""
    rows = max(1, math.ceil(len(tasks) / MOST_COLUMNS))
    columns = max(1, math.ceil(len(tasks) / rows))
    figure = _figure(0.5 + 1.5 * rows)
    panels = [
        figure.add_subplot(rows, columns, index + 1) for index in range(len(tasks))
    ]
    for index, (axes, task) in enumerate(zip(panels, tasks, strict=True)):
        for stage in range(1, task.max_stage + 1):
            level = stage / task.max_stage
            axes.axhline(
                level,
                color=_FAINT,
                linewidth=0.5,
                alpha=0.6,
                zorder=0,
            )
        axes.set_title(_short(task.title), fontsize=9, loc="left")
        axes.set_yticks([0, 0.5, 1], ["0", "0.5", "1"])
        axes.set(xlim=(0, 100), ylim=(0, 1.04), xticks=[0, 50, 100])
        axes.tick_params(labelleft=index % columns == 0, labelsize=8)
    figure.supxlabel("Time / % of the horizon", fontsize=9)
    figure.supylabel("Mean progress", fontsize=9)
    return figure, panels


def overlaid_progress(
    tasks: Sequence[TaskInfo], runs: Sequence[tuple[str, Mapping[str, TaskResult]]]
) -> Figure:
    """One panel a task, with a curve for each named run, results by the task's id, and a legend."""
    figure, panels = _progress_panels(tasks)
    names = [name for name, _ in runs]
    for axes, task in zip(panels, tasks, strict=True):
        for style, (_, results) in zip(_styles(len(runs)), runs, strict=True):
            result = results.get(task.id)
            if result:
                axes.step(
                    TIME,
                    result.progress,
                    where="post",
                    linewidth=1.6,
                    **style,
                )
    columns = 1 if max(map(len, names)) > _LONG_NAME else 3
    _add_legend(figure, names, columns)
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + 0.2 * -(-len(runs) // columns))
    return figure


def levels(axes: Sequence[str], runs: Sequence[tuple[str, Levels]]) -> Figure:
    """One panel for each axis of shifts, with a curve for each named run.

    Whiskers are 95 % Wilson intervals.
    """
    columns = min(MOST_COLUMNS, max(1, len(axes)))
    rows = -(-max(1, len(axes)) // columns)
    figure = _figure(1.75 * rows + 0.5)
    panels = figure.subplots(
        rows, columns, squeeze=False, sharex=True, sharey=True
    ).ravel()
    for panel, axis in zip(panels, axes, strict=False):
        panel.set_title(
            "all axes" if axis == ALL_AXES else axis, fontsize=9, loc="left"
        )
        panel.set(xticks=range(LEVELS + 1), yticks=[0, 25, 50, 75, 100])
        panel.set(xlim=(-0.3, LEVELS + 0.3), ylim=(-4, 104))
        panel.grid(axis="y", linewidth=0.4, alpha=0.5)
        for index, (style, (_, reached)) in enumerate(
            zip(_styles(len(runs)), runs, strict=True)
        ):
            scores = reached.get(axis)
            if scores:
                _plot_levels(
                    panel, scores, style, _APART * (index - (len(runs) - 1) / 2)
                )
    for panel in panels[len(axes) :]:
        panel.set_visible(False)
    figure.supxlabel("Level", fontsize=9)
    figure.supylabel("Success / %", fontsize=9)
    if len(runs) > 1:
        _add_legend(figure, [name for name, _ in runs], 3)
    return figure


def _plot_levels(
    panel: Axes, scores: Mapping[int, Score], style: Mapping[str, Any], aside: float
) -> None:
    at = [level + aside for level in scores]
    rates = [100 * (score.success_rate or 0.0) for score in scores.values()]
    panel.plot(
        at,
        rates,
        marker="o",
        markersize=3.2,
        linewidth=1.5,
        **style,
    )
    lows = [100 * score.interval[0] for score in scores.values()]
    highs = [100 * score.interval[1] for score in scores.values()]
    panel.vlines(
        at,
        lows,
        highs,
        color=style["color"],
        linewidth=1.0,
        alpha=0.6,
    )


def _styles(count: int) -> list[dict[str, Any]]:
    """Styles of the curves of runs: colours and dashes, each of which is enough."""
    each = zip(
        range(count),
        cycle(COLOURS),
        cycle(DASHES),
        strict=False,
    )
    return [{"color": colour, "linestyle": dashes} for _, colour, dashes in each]


def _add_legend(
    figure: Any,
    names: Sequence[str],
    columns: int,
) -> None:
    handles = [
        Line2D(
            [],
            [],
            linewidth=1.8,
            label=name,
            **style,
        )
        for name, style in zip(names, _styles(len(names)), strict=True)
    ]
    figure.legend(
        handles=handles,
        loc="outside upper left",
        ncols=columns,
        frameon=False,
        handlelength=3.5,
    )


FIGURES: Mapping[str, Callable[[Results], Figure]] = {
    "stages": stage_bars,
    "progress": progress_over_time,
}


def plots(results: Results) -> dict[str, str]:
    """Every one of `FIGURES` as an SVG document, by its name."""
    return {name: as_svg(name, make, results) for name, make in FIGURES.items()}


def as_svg(
    name: str,
    make: Callable[[*Values], Figure],
    *values: *Values,
) -> str:
    """A figure as an SVG document, in the style of all figures; the same one has the same text.

    Its name is another one than that of every figure on the same page.
    """
    # Identifiers inside are hashes; with a salt of its own, no two figures on a page share one.
    buffer = io.StringIO()
    with (
        # A user's own settings of Matplotlib change no figure.
        matplotlib.style.context({**_STYLE, "svg.hashsalt": name}, after_reset=True),
        warnings.catch_warnings(
            action="ignore", category=UserWarning
        ),  # of glyphs and narrow axes
    ):
        figure: Any = make(*values)
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def for_page(svg: str) -> str:
    """The `<svg>` element of a figure's document, for a page: without a background.

    It is scalable, its ink in the colour of the text around it, its curves in the page's accent,
    without a style sheet, which would reach the whole page, and without the names of its groups,
    which would not be unique on a page with several figures.
    """
    element = re.sub(
        r' (width|height)="[^"]*"',
        "",
        svg[svg.index("<svg") :],
        count=2,
    )
    for unwanted in (
        "<style.*?</style>",
        "<metadata>.*?</metadata>",
        '<g id="patch_1">.*?</g>',
    ):
        element = re.sub(
            unwanted,
            "",
            element,
            count=1,
            flags=re.DOTALL,
        )
    element = re.sub(r'<g id="[^"]*"', "<g", element)
    return element.replace(INK, "currentColor").replace(CURVE, "var(--accent)")
