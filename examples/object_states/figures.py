"""Draw what the networks of `table.py` reached: by number, variety and end of demonstrations.

python figures.py --numbers runs/baselines --out learning.png \
    --varieties none=runs/none human=runs/baselines wide=runs/wide \
    --ends release=runs/release success=runs/success "a second later"=runs/baselines
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from duobench.results.bundle import read_source
from duobench.results.scores import wilson_interval

TASKS = ("bin_sort", "carry_pot", "transfer_gate")
NUMBERS = (10, 25, 50, 100, 200)
COLOURS = colormaps["viridis"](np.linspace(0.15, 0.8, len(TASKS)))
MARKERS = "os^"


@dataclass(frozen=True)
class Rate:
    """Success in per cent, mean of all training seeds, with the interval of one seed's episodes."""

    mean: float
    low: float
    high: float


def rate(folder: Path, task: str) -> Rate:
    """What the networks in a folder of `table.py` reached on a task.

    Args:
        folder: That of one number of demonstrations.
        task: The task.
    """
    runs = sorted(folder.glob(f"runs/{task}/mlp-*"))
    records = [read_source(run)[1] for run in runs]
    mean = float(np.mean([record.success for run in records for record in run]))
    trials = len(records[0])
    low, high = wilson_interval(round(mean * trials), trials)
    return Rate(100 * mean, 100 * low, 100 * high)


def draw_numbers(axes: Axes, folder: Path) -> None:
    """Lines of success against the number of demonstrations."""
    for task, colour, marker in zip(TASKS, COLOURS, MARKERS, strict=True):
        rates = [rate(folder / str(number), task) for number in NUMBERS]
        axes.plot(NUMBERS, [r.mean for r in rates], color=colour, marker=marker, label=task)
        bounds = [r.low for r in rates], [r.high for r in rates]
        axes.fill_between(NUMBERS, *bounds, color=colour, alpha=0.15, linewidth=0)
    axes.set_xscale("log")
    axes.set_xticks(NUMBERS, [str(number) for number in NUMBERS], minor=False)
    axes.set_xticks([], minor=True)
    axes.set_xlabel("demonstrations")
    axes.legend(frameon=False, loc="upper left")


def draw_groups(axes: Axes, folders: Mapping[str, Path], demonstrations: int) -> None:
    """Bars of success, a group for each folder."""
    width = 0.8 / len(TASKS)
    for nth, (task, colour) in enumerate(zip(TASKS, COLOURS, strict=True)):
        rates = [rate(folder / str(demonstrations), task) for folder in folders.values()]
        places = np.arange(len(rates)) + (nth - (len(TASKS) - 1) / 2) * width
        spread = [[r.mean - r.low for r in rates], [r.high - r.mean for r in rates]]
        means = [r.mean for r in rates]
        axes.bar(places, means, width, yerr=spread, color=colour, ecolor="0.3", capsize=2)
        for place, each in zip(places, rates, strict=True):
            axes.text(place, each.high + 1, f"{each.mean:.0f}", ha="center", fontsize=8)
    axes.set_xticks(range(len(folders)), list(folders))


def named(words: Sequence[str]) -> dict[str, Path]:
    """Folders by their names, as `NAME=FOLDER`."""
    return {name: Path(folder) for name, _, folder in (word.partition("=") for word in words)}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--numbers", type=Path, required=True)
    parser.add_argument("--varieties", nargs="+", required=True)
    parser.add_argument("--ends", nargs="+", required=True)
    parser.add_argument("--demonstrations", type=int, default=50, help="in the groups of bars")
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    draw_numbers(panels[0], asked.numbers)
    draw_groups(panels[1], named(asked.varieties), asked.demonstrations)
    draw_groups(panels[2], named(asked.ends), asked.demonstrations)
    panels[0].set_ylabel("success (%)")
    panels[0].set_ylim(0, 105)
    panels[1].set_xlabel(f"variety of {asked.demonstrations} demonstrations")
    panels[2].set_xlabel(f"end of {asked.demonstrations} demonstrations")
    for panel in panels:
        panel.spines[["top", "right"]].set_visible(False)
    figure.savefig(asked.out, dpi=110, metadata={"Software": None})
