"""`duobench report`: write the report of a run anew."""

from __future__ import annotations

from pathlib import Path

import tyro

from duobench.cli.advice import find_folder
from duobench.cli.display.console import console


def report(folder: tyro.conf.Positional[Path]) -> None:
    """Compute table, figures and page from the records in a run's folder.

    Args:
        folder: What was given to --out of duobench eval; the run need not be finished.
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
    write_report(run_folder)
    screen.print(f"Report: {folder / run_folder.page.name}")
