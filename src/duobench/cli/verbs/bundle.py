"""`duobench bundle`: one file of a run and its records, for publication."""

from __future__ import annotations

import hashlib
from pathlib import Path

import tyro

from duobench.cli.shared.advice import AdvisedError, find_run, relative
from duobench.cli.shared.console import console, counted


def bundle(folder: tyro.conf.Positional[Path], out: Path | None = None) -> None:
    """Write a run and its records into one file for publication, without videos and timing.

    Args:
        folder: What was given to --out of duobench eval; the run need not be finished.
        out: The file. Default: NAME.duobench.zip beside the folder NAME.
    """
    find_run(folder)
    from duobench.results.bundle import BUNDLE_SUFFIX, write_bundle
    from duobench.results.folder import RunFolder

    if folder.is_file():
        raise AdvisedError(
            f"{folder} is a file, which holds no evaluation; give the folder of a run."
        )
    reader = RunFolder(folder)
    whole = reader.path.resolve()  # which has a name, also where `.` was given
    path = out or relative(whole.with_name(f"{whole.name}{BUNDLE_SUFFIX}"))
    manifest = write_bundle(reader, path)
    screen = console()
    if manifest.missing:
        missing = counted(manifest.missing, "episode")
        screen.print(f"The run is unfinished: no record of {missing}.")
    screen.print(f"Bundle: {path}, {counted(len(manifest.parts) - 1, 'record')}")
    screen.print(f"SHA-256: {hashlib.sha256(path.read_bytes()).hexdigest()}")
