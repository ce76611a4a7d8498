"""`duobench report`: write the report of a run anew."""

from __future__ import annotations

from pathlib import Path

import tyro

from duobench.cli.console import console
from duobench.cli.engine import load_engine


def report(folder: tyro.conf.Positional[Path]) -> None:
    """Compute table, figures and page from the records in a run's folder.

    Args:
        folder: What was given to --out of duobench eval; the run need not be finished.
    """
    load_engine()
    from duobench.evaluation.folder import RunFolder
    from duobench.evaluation.report import write_report
    from duobench.evaluation.table import results_table

    run_folder = RunFolder(folder)
    results = write_report(run_folder)
    screen = console()
    screen.print(results_table(results, run_folder.read_run().episodes))
    screen.print(f"Report: {run_folder.page}", soft_wrap=True)
