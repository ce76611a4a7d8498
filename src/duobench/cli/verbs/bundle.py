"""`duobench bundle`: one file of a run and its records, for publication."""

from __future__ import annotations

import hashlib
from pathlib import Path

import tyro

from duobench.cli.shared.advice import AdvisedError, conditions_of, find_runs, relative
from duobench.cli.shared.console import console, counted


def bundle(folder: tyro.conf.Positional[tuple[Path, ...]], out: Path | None = None) -> None:
    """Write a run and its records into one file for publication, without videos and timing.

    Args:
        folder: What was given to --out of duobench eval; the run need not be finished. Or the
            folders of all shards of a run.
        out: The file. Default: NAME.duobench.zip beside the folder NAME.
    """
    find_runs(folder)
    from duobench.results.bundle import BUNDLE_SUFFIX, write_bundle
    from duobench.results.source import open_sources
    from duobench.results.suites.merged import check_whole

    if any(path.is_file() for path in folder):
        raise AdvisedError(
            f"{folder[0]} is a file, which holds no evaluation; give the folder of a run."
        )
    if len(folder) == 1 and (conditions := conditions_of(folder[0])):
        raise AdvisedError(
            f"{folder[0]} holds {len(conditions)} conditions, each a run of its own. Bundle one, "
            f"such as {conditions[0]}."
        )
    reader = open_sources(folder)
    check_whole(reader)
    whole = reader.path.resolve()  # which has a name, also where `.` was given
    path = out or relative(whole.with_name(f"{whole.name}{BUNDLE_SUFFIX}"))
    manifest = write_bundle(reader, path)
    screen = console()
    if manifest.missing:
        missing = counted(manifest.missing, "episode")
        screen.print(f"The run is unfinished: no record of {missing}.")
    screen.print(f"Bundle: {path}, {counted(len(manifest.parts) - 1, 'record')}")
    screen.print(f"SHA-256: {hashlib.sha256(path.read_bytes()).hexdigest()}")
