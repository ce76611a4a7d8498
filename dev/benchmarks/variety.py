"""Measure how far a variety spreads the paths of the tools, beside the spread of layouts alone.

`python -m dev.benchmarks.variety --variety human --figure docs/start/variety.png` plays each task's
expert in
one layout with ten seeds of the variety, and without variety in ten layouts. In one layout an
expert without variety always takes the same path, so layouts explain nothing of the first spread.
"""

from __future__ import annotations

import argparse
import io
import multiprocessing
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import gymnasium as gym
import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image
from rich.console import Console
from rich.progress import track
from rich.table import Table

import duobench
from duobench.core.randomness import TRAIN
from duobench.core.types import CONTROL_HZ, SIDES
from duobench.evaluation.policies import ExpertPolicy
from duobench.tasks import catalog
from duobench.tasks.experts.variety import HUMAN, NONE, VARIETIES

Array = NDArray[np.float64]

EPISODES = 10
"""Seeds of a variety, and layouts, whose paths are compared."""
LAYOUT_SEED = 0
"""Seed of the layout that stays the same."""
POINTS = 200
"""Points of a path, at equal distances along it, that are compared."""
POSE_SIZE = 7
COLOURS = ("#2a6f98", "#c8641e")
"""Left and right arm."""
INK, FAINT = "#1c2024", "#b4b9bd"
SIZE, DPI = (9.6, 7.4), 100
"""Size of the figure in inches, and pixels in an inch."""
COLOUR_COUNT = 64


@dataclass(frozen=True, kw_only=True, slots=True)
class Paths:
    """Where the tools of an expert went in some episodes."""

    positions: tuple[Array, ...]
    """Tool positions (steps, 2, 3) of each episode in the table frame, in metres."""

    @property
    def spread(self) -> Array:
        """Root mean square distance (2,) of the left and right path from the mean one, in metres.

        Paths are compared at equal shares of their length, so that speed makes no difference.
        """
        paths = np.array([resampled(path) for path in self.positions])
        return np.sqrt(((paths - paths.mean(axis=0)) ** 2).sum(axis=-1).mean(axis=(0, 1)))

    @property
    def seconds(self) -> Array:
        """Durations of the episodes."""
        return np.array([len(path) for path in self.positions]) / CONTROL_HZ


@dataclass(frozen=True, kw_only=True, slots=True)
class Comparison:
    """What a variety does to one task's paths."""

    task: str
    """Id of the task."""
    varied: Paths
    """One layout, other seeds of the variety."""
    plain: Paths
    """Other layouts without variety, that of `varied` first."""


def resampled(path: Array) -> Array:
    """Points (POINTS, 2, 3) at equal distances along each arm's path (steps, 2, 3)."""
    shares = np.linspace(0.0, 1.0, POINTS)
    points = np.empty((POINTS, *path.shape[1:]))
    for side in SIDES:
        mine = path[:, side.index]
        along = np.concatenate([[0.0], np.linalg.norm(np.diff(mine, axis=0), axis=1).cumsum()])
        for axis, values in enumerate(mine.T):
            points[:, side.index, axis] = np.interp(shares * along[-1], along, values)
    return points


def path_of(env: gym.Env, expert: ExpertPolicy, *, layout_seed: int, seed: int) -> Array:
    """Tool positions (steps, 2, 3) of an episode in the table frame, in metres.

    Args:
        env: The environment.
        expert: Its expert.
        layout_seed: Seed of the layout.
        seed: Seed of the expert.
    """
    observation, info = env.reset(seed=layout_seed)
    expert.reset(info["instruction"], seed)
    positions, over = [], False
    while not over:
        action = np.asarray(expert.act(observation), dtype=np.float32)[0]
        observation, _, terminated, truncated, _ = env.step(action)
        positions.append(observation["tcp_pose"].reshape(len(SIDES), POSE_SIZE)[:, :3])
        over = terminated or truncated
    return np.array(positions, dtype=np.float64)


def compare(task: str, variety: str, episodes: int = EPISODES) -> Comparison:
    """Play one task with a variety and without."""
    env = duobench.make(task, cameras=False, split=TRAIN)
    varied, plain = ExpertPolicy(env, VARIETIES[variety]), ExpertPolicy(env, NONE)
    result = Comparison(
        task=task,
        varied=Paths(
            positions=tuple(
                path_of(env, varied, layout_seed=LAYOUT_SEED, seed=seed) for seed in range(episodes)
            )
        ),
        plain=Paths(
            positions=tuple(
                path_of(env, plain, layout_seed=LAYOUT_SEED + number, seed=0)
                for number in range(episodes)
            )
        ),
    )
    env.close()
    return result


def table_of(comparisons: Sequence[Comparison], variety: str) -> Table:
    """One row a task."""
    table = Table(title="Spread of the tool paths, left / right, and durations of the episodes")
    table.add_column("task", no_wrap=True)
    for what in (f"one layout, {variety}", "layouts, no variety"):
        table.add_column(f"{what} (mm)", justify="right")
        table.add_column("(s)", justify="right")
    for comparison in comparisons:
        cells = [comparison.task]
        for paths in (comparison.varied, comparison.plain):
            left, right = 1000.0 * paths.spread
            cells += [
                f"{left:.0f} / {right:.0f}",
                f"{paths.seconds.min():.1f} to {paths.seconds.max():.1f}",
            ]
        table.add_row(*cells)
    return table


def figure_of(comparisons: Sequence[Comparison], variety: str) -> Figure:
    """Tool paths from above, one panel a task; the robot is below, its left is left."""
    with mpl.rc_context({"font.size": 8.0, "text.color": INK, "axes.edgecolor": FAINT}):
        figure = Figure(figsize=SIZE, dpi=DPI, layout="constrained")
        columns = 4
        rows = -(-(len(comparisons) + 1) // columns)
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for panel, comparison in zip(panels, comparisons, strict=False):
            _draw(panel, comparison)
        for panel in panels[len(comparisons) :]:
            panel.set_axis_off()
        legend = panels[len(comparisons)]
        for colour, label in (
            (COLOURS[0], f"left arm, one layout, {variety}"),
            (COLOURS[1], f"right arm, one layout, {variety}"),
            (INK, "the same layout, no variety"),
            (FAINT, "other layouts, no variety"),
        ):
            legend.plot([], [], color=colour, label=label)
        legend.legend(loc="center", frameon=False)
        return figure


def _draw(panel: Axes, comparison: Comparison) -> None:
    panel.set_title(comparison.task, fontsize=9.0)
    for side in SIDES:
        for path in comparison.plain.positions[1:]:
            panel.plot(path[:, side.index, 1], path[:, side.index, 0], color=FAINT, lw=0.4)
    for side in SIDES:
        for path in comparison.varied.positions:
            colour = COLOURS[side.index]
            panel.plot(path[:, side.index, 1], path[:, side.index, 0], color=colour, lw=0.7)
        path = comparison.plain.positions[0]
        panel.plot(path[:, side.index, 1], path[:, side.index, 0], color=INK, lw=0.9)
    panel.invert_xaxis()
    panel.set_aspect("equal", adjustable="datalim")
    panel.tick_params(labelsize=6, colors=INK, length=2)


def save(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG of few colours, a third as large as one of all colours."""
    pixels = io.BytesIO()
    figure.savefig(pixels)
    Image.open(pixels).convert("RGB").quantize(COLOUR_COUNT).save(path, "PNG", optimize=True)


def main() -> None:
    """Compare the tasks that the arguments name; print a table, draw a figure if asked for."""
    parser = argparse.ArgumentParser(prog="python -m dev.benchmarks.variety", description=__doc__)
    parser.add_argument("--variety", choices=tuple(VARIETIES), default=HUMAN.name)
    parser.add_argument("--tasks", nargs="+", choices=catalog.names(), default=catalog.names())
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--figure", type=Path, help="where the figure is written, as PNG")
    arguments = parser.parse_args()
    with multiprocessing.get_context("spawn").Pool(arguments.workers) as pool:
        jobs = pool.imap(partial(compare, variety=arguments.variety), arguments.tasks)
        comparisons = list(track(jobs, description="Playing", total=len(arguments.tasks)))
    Console(width=100).print(table_of(comparisons, arguments.variety))
    if arguments.figure:
        save(figure_of(comparisons, arguments.variety), arguments.figure)


if __name__ == "__main__":
    main()
