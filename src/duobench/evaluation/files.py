"""Writing files so that a reader, or a restart after a kill, never meets half of one."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from duobench.errors import EvaluationError

TEMPORARY_SUFFIX = ".tmp"
"""Ending of a file that is being written; whatever still carries it after a crash is rubbish."""


def make_folder(path: Path) -> None:
    """Make a folder to write into, with its parents; one that is there is taken.

    Raises:
        EvaluationError: It cannot be made, or nothing may be written into it.
    """
    reason = None
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        reason = "it is a file"
    except OSError as error:
        reason = error.strerror
    else:
        if not os.access(path, os.W_OK | os.X_OK):
            reason = "nothing may be written into it"
    if reason:
        raise EvaluationError(
            f"{path} cannot be the folder of the output: {reason}. Give --out another one."
        )


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Write a file under a temporary name, and give it its name only once it is complete.

    Args:
        path: Where the file will be; missing parent folders are made.

    Yields:
        The temporary path beside it. When the block ends well the bytes are flushed to the disk
        and the file appears under its name at once; when it raises, or has written nothing,
        nothing appears.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}{TEMPORARY_SUFFIX}")
    try:
        yield temporary
        if temporary.exists():
            with temporary.open("rb") as written:
                os.fsync(written.fileno())
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file (UTF-8, line feeds) in one atomic step."""
    with replacing(path) as temporary:
        temporary.write_bytes(text.encode())


def remove_temporary(folder: Path) -> None:
    """Remove what interrupted writers left anywhere under a folder."""
    for path in folder.rglob(f".*{TEMPORARY_SUFFIX}"):
        path.unlink(missing_ok=True)
