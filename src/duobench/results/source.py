"""Where results are read from: the folder of a run, the folders of its shards, or a bundle."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from duobench.errors import EvaluationError
from duobench.results.bundle import Bundle
from duobench.results.folder import RunFolder
from duobench.results.reader import DESCRIPTION, RunReader
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suites.merged import MergedRun, check_whole, shards_in


def open_source(path: Path) -> RunReader:
    """What reads a run and its records one by one; see `open_sources`.

    Raises:
        EvaluationError: Shards in the folder are not all shards of one run.
        FileError: If a file is no bundle, or a damaged one.
    """
    return open_sources([path])


def open_sources(paths: Sequence[Path]) -> RunReader:
    """What reads a run, whole or in shards.

    Args:
        paths: The folder of a run, a file that `duobench bundle` has written, the folder that the
            shards of a run lie in, or the folders of all shards. A pattern such as `runs/x/*`
            stands for what it matches, where no file has this name.

    Raises:
        EvaluationError: There is nothing, or the folders are not all shards of one run.
        FileError: A file is no bundle, or a description cannot be read.
    """
    found = [place for path in paths for place in _matching(path)]
    if len(found) != 1:
        return MergedRun([_opened(path) for path in found], found[0].parent)
    (path,) = found
    if shards := shards_in(path):
        return MergedRun([RunFolder(each) for each in shards], path)
    return _opened(path)


def read_source(path: Path) -> tuple[Run, list[EpisodeRecord]]:
    """A whole run and its records, finished or not.

    Args:
        path: See `open_sources`.

    Raises:
        EvaluationError: If there is no run, one shard of one, or a record of another one.
        FileError: If a record or a bundle cannot be read.
    """
    source = open_source(path)
    check_whole(source)
    run = source.read_run()
    return run, source.read_records(run)


def _opened(path: Path) -> RunReader:
    return Bundle(path) if path.is_file() else RunFolder(path)


def _matching(path: Path) -> list[Path]:
    """A path, or what it matches as a pattern."""
    if path.exists() or not set("*?[") & set(str(path)):
        return [path]
    anchor = Path(path.anchor or ".")
    pattern = str(path.relative_to(anchor)) if path.anchor else str(path)
    found = sorted(each for each in anchor.glob(pattern) if (each / DESCRIPTION).exists())
    if not found:
        raise EvaluationError(f"No folder with a run matches {path}.")
    return found
