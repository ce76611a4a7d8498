"""`duobench report`: write the report of a run anew."""

from __future__ import annotations

from pathlib import Path

import tyro

from duobench.cli.advice import AdvisedError, find_folder
from duobench.cli.display.console import console


def report(source: tyro.conf.Positional[Path], out: Path | None = None) -> None:
    """Compute table, figures and page from the records of a run.

    Args:
        source: What was given to --out of duobench eval, whose run need not be finished, or a file
            that duobench bundle has written.
        out: Folder of the report of a bundle; that of a run lies in the run's own folder.
    """
    is_bundle = source.is_file()
    if not is_bundle:
        find_folder(source, "run.json")
    if is_bundle != (out is not None):
        raise AdvisedError(
            f"{source} is a bundle: say with --out where its report shall be."
            if is_bundle
            else "--out is for the report of a bundle; that of a run lies in the run's own folder."
        )
    from duobench.cli.display.table import results_table
    from duobench.results.folder import RunFolder
    from duobench.results.report import read_results, write_report
    from duobench.results.source import open_source

    reader = open_source(source)
    run, results = read_results(reader)
    screen = console()
    # First, so that the table of a folder can be had by who may only read it.
    screen.print(results_table(run, results))
    folder = out or source
    run_folder = RunFolder(folder)
    write_report(run_folder, reader if is_bundle else None)
    screen.print(f"Report: {folder / run_folder.page.name}")
