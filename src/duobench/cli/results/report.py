"""`duobench report`: write the report of a run anew, and make videos of its episodes."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.advice import find_folder
from duobench.cli.display.console import console, counted
from duobench.cli.doctor import load_engine

if TYPE_CHECKING:
    from rich.console import Console

    from duobench.results.folder import RunFolder


def report(folder: tyro.conf.Positional[Path], videos: tuple[str, ...] = ()) -> None:
    """Compute table, figures and page from the records in a run's folder.

    The exit code is 1 if a video that was asked for cannot be made.

    Args:
        folder: What was given to --out of duobench eval; the run need not be finished.
        videos: Make videos of these finished episodes first, from what was sent in them: failures,
            all, or TASK:EPISODE such as bin_sort:3, one or several. One that is there stays.
    """
    find_folder(folder, "run.json")
    from duobench.cli.display.table import results_table
    from duobench.results.folder import RunFolder
    from duobench.results.report import read_results, write_report

    run_folder = RunFolder(folder)
    run, results = read_results(run_folder)
    screen = console()
    # First, so that the table of a folder can be had by who may only read it.
    screen.print(results_table(run, results))
    impossible = _make_videos(run_folder, videos, screen) if videos else 0
    write_report(run_folder)
    screen.print(f"Report: {folder / run_folder.page.name}")
    if impossible:
        sys.exit(1)


def _make_videos(folder: RunFolder, words: tuple[str, ...], screen: Console) -> int:
    """Make the videos that words choose, and return how many cannot be made."""
    load_engine()
    from duobench.cli.display.progress import display
    from duobench.evaluation.videos import choose, make_videos
    from duobench.results.source import read_source

    run, records = read_source(folder.path)
    chosen = choose(run, records, words)
    with display(screen, "video") as shown:
        videos = make_videos(folder, run, chosen, shown.tell)
    for record, reason in videos.impossible:
        screen.print(f"No video of {record.task}, episode {record.episode}: {reason}")
    there = f", {len(videos.there)} there before" if videos.there else ""
    screen.print(f"{counted(len(videos.made), 'video')} made{there}")
    return len(videos.impossible)
