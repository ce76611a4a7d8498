"""`duobench bundle`: a run as one file."""

from __future__ import annotations

from pathlib import Path

import tyro

from duobench.cli.shared.advice import AdvisedError, find_run, relative
from duobench.cli.shared.console import counted, say
from duobench.cli.shared.folders import tell_missing
from duobench.core.files import check_outside, digest_of
from duobench.results.bundle import BUNDLE_SUFFIX, write_bundle
from duobench.results.folder import RunFolder


def run(folder: tyro.conf.Positional[Path], out: Path | None = None) -> None:
    """Write a run and its records into one file for publication, without videos and timing.

    Args:
        folder: What was given to --out of duobench eval; the run need not be finished.
        out: The file. Default: NAME.duobench.zip beside the folder NAME.
    """
    find_run(folder)
    if folder.is_file():
        raise AdvisedError(
            f"{folder} is a file, which holds no evaluation; give the folder of a run."
        )
    reader = RunFolder(folder)
    whole = reader.path.resolve()  # which has a name, also where `.` was given
    path = out or relative(whole.with_name(f"{whole.name}{BUNDLE_SUFFIX}"))
    check_outside(path, reader.path)
    tell_missing(reader)
    manifest = write_bundle(reader, path)
    if manifest.missing:
        say(
            f"The run is unfinished: no record of {counted(manifest.missing, 'episode')}."
        )
    say(f"Bundle: {path}, {counted(len(manifest.parts) - 1, 'record')}")
    say(f"SHA-256: {digest_of(path)}")
