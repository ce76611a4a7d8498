"""Success against the level of each axis, one panel an axis, one curve a policy."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from duobench.results.comparison.figures import COLOURS, DASHES
from duobench.results.figures import MOST_COLUMNS, WIDTH
from duobench.results.robustness.conditions import Robustness
from duobench.shifts.shift import ALL_AXES, AXES, LEVELS

_HEIGHT = 1.75
"""Of a row of panels, in inches."""
_APART = 0.06
"""Between the markers of two policies at one level, in levels."""


def levels_figure(policies: Sequence[Robustness]) -> Figure:
    """One panel for each axis that a policy was played on; whiskers are 95 % Wilson intervals."""
    axes_names = [axis for axis in AXES if any(axis in one.axes for one in policies)]
    columns = min(MOST_COLUMNS, max(1, len(axes_names)))
    rows = -(-max(1, len(axes_names)) // columns)
    figure = Figure(figsize=(WIDTH, _HEIGHT * rows + 0.5), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for panel, axis in zip(panels, axes_names, strict=False):
        _frame(panel, axis)
        for index, one in enumerate(policies):
            _curve(panel, one, axis, index, _APART * (index - (len(policies) - 1) / 2))
    for panel in panels[len(axes_names) :]:
        panel.set_visible(False)
    figure.supxlabel("Level", fontsize=9)
    figure.supylabel("Success / %", fontsize=9)
    if len(policies) > 1:
        figure.legend(
            handles=[_line(index, one.title) for index, one in enumerate(policies)],
            loc="outside upper left",
            ncols=3,
            frameon=False,
            handlelength=3.5,
        )
    return figure


def _frame(panel: Axes, axis: str) -> None:
    panel.set_title("all axes" if axis == ALL_AXES else axis, fontsize=9, loc="left")
    panel.set_xticks(range(LEVELS + 1))
    panel.set_xlim(-0.3, LEVELS + 0.3)
    panel.set_ylim(-4, 104)
    panel.set_yticks([0, 25, 50, 75, 100])
    panel.grid(axis="y", linewidth=0.4, alpha=0.5)


def _curve(panel: Axes, one: Robustness, axis: str, index: int, shift: float) -> None:
    if axis not in one.axes:
        return
    levels = one.levels(axis)
    scores = [score for level in levels if (score := one.score(axis, level))]
    rates = [100 * (score.success_rate or 0.0) for score in scores]
    line = _line(index, one.title)
    style = {"color": line.get_color(), "linestyle": line.get_linestyle()}
    at = [level + shift for level in levels]
    panel.plot(at, rates, marker="o", markersize=3.2, linewidth=1.5, **style)
    lows = [100 * score.interval[0] for score in scores]
    highs = [100 * score.interval[1] for score in scores]
    panel.vlines(at, lows, highs, color=line.get_color(), linewidth=1.0, alpha=0.6)


def _line(index: int, label: str) -> Line2D:
    colour, dashes = COLOURS[index % len(COLOURS)], DASHES[index % len(DASHES)]
    return Line2D([], [], color=colour, linestyle=dashes, linewidth=1.8, label=label)
