"""Where results are read from: the folder of a run, or a bundle of one."""

from __future__ import annotations

from pathlib import Path

from duobench.results.bundle import Bundle
from duobench.results.folder import RunFolder
from duobench.results.reader import RunReader
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run


def open_source(path: Path) -> RunReader:
    """What reads a run and its records one by one.

    Args:
        path: Folder of the run, or a file that `duobench bundle` has written.

    Raises:
        FileError: If a file is no bundle, or a damaged one.
    """
    return Bundle(path) if path.is_file() else RunFolder(path)


def read_source(path: Path) -> tuple[Run, list[EpisodeRecord]]:
    """A run and its records, finished or not.

    Args:
        path: Folder of the run, or a file that `duobench bundle` has written.

    Raises:
        EvaluationError: If there is no run, or a record of another one.
        FileError: If a record or a bundle cannot be read.
    """
    source = open_source(path)
    run = source.read_run()
    return run, source.read_records(run)
