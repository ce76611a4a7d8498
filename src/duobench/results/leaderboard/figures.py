"""The figure of a leaderboard: where the episodes of its best policies ended."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from duobench.results.figures import WIDTH, frame_bars, stage_bar
from duobench.results.leaderboard.board import Board, Entry

MOST = 5
"""Ranked policies that are shown; one privileged policy stands below them."""
_GAP = 0.5
"""Between the bars of two tasks, in bars."""


def shown(board: Board) -> list[tuple[str, Entry]]:
    """The policies of the figure, each with the word that stands beside its bars."""
    best = [(str(one.rank), one.entry) for one in board.ranked(privileged=False)[:MOST]]
    privileged = [("P", one.entry) for one in board.ranked(privileged=True)[:1]]
    return best + privileged


def stages(entries: Sequence[tuple[str, Entry]]) -> Figure:
    """One bar for each policy in each task, with its word.

    Args:
        entries: Policies that have played the whole suite, as `shown` gives them; at least one.
    """
    bars = []
    titles = []
    at = 0.0
    for number, one in enumerate(entries[0][1].results.tasks):
        titles.append((at, one.task.title))
        for word, entry in entries:
            bars.append((at, word, entry.results.tasks[number]))
            at += 1
        at += _GAP
    figure = Figure(figsize=(WIDTH, 0.75 + 0.27 * at), layout="constrained")
    axes = figure.add_subplot()
    for place, _, result in bars:
        stage_bar(axes, place, result)
    axes.set_yticks([place for place, *_ in bars], [word for _, word, _ in bars], weight="bold")
    named = axes.secondary_yaxis(-0.035)
    named.set_yticks([place for place, _ in titles], [title for _, title in titles])
    named.tick_params(length=0)
    named.spines["left"].set_visible(False)
    axes.set_ylim(at - _GAP - 0.5, -0.5)
    frame_bars(axes)
    return figure
