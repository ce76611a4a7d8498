"""Where results are read from: the folder of a run."""

from __future__ import annotations

from pathlib import Path

from duobench.results.folder import RunFolder
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run


def read_source(path: Path) -> tuple[Run, list[EpisodeRecord]]:
    """A run and its records, finished or not.

    Args:
        path: Folder of the run.

    Raises:
        EvaluationError: If there is no run, or a record of another one.
        FileError: If a record cannot be read.
    """
    folder = RunFolder(path)
    run = folder.read_run()
    return run, folder.read_records(run)
