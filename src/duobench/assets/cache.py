"""The user's cache on disk: where it is, atomic writes, and one lock for all processes."""

from __future__ import annotations

import contextlib
import os
import secrets
import sys
from collections.abc import Iterator
from pathlib import Path

from duobench.assets.manifest import MeshFile
from duobench.errors import AssetError

CACHE_VARIABLE = "DUOBENCH_CACHE"


def cache_dir() -> Path:
    """Return the cache folder: `DUOBENCH_CACHE`, or "duobench" in the platform's cache folder."""
    if chosen := os.environ.get(CACHE_VARIABLE):
        return Path(chosen).expanduser()
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
        return Path(base) / "duobench" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "duobench"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "duobench"


def file_path(cache: Path, file: MeshFile) -> Path:
    """Return where the cache keeps a file: by content, so that versions never collide."""
    return cache / "files" / f"{file.sha256}{Path(file.name).suffix}"


def write_atomic(path: Path, data: bytes) -> None:
    """Write a file so that readers see the old bytes or all of the new ones, never a part.

    Raises:
        AssetError: The folder cannot be written.
    """
    part = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with part.open("xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise _unwritable(path.parent, error) from error


@contextlib.contextmanager
def locked(cache: Path) -> Iterator[None]:
    """Hold the cache's lock; other processes wait until it is free.

    The operating system drops the lock with the process, so a killed one leaves nothing behind.

    Raises:
        AssetError: The cache folder cannot be written.
    """
    try:
        cache.mkdir(parents=True, exist_ok=True)
        handle = os.open(cache / "lock", os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise _unwritable(cache, error) from error
    try:
        _wait_for_lock(handle)
        yield
    finally:
        os.close(handle)


if sys.platform == "win32":

    def _wait_for_lock(handle: int) -> None:
        import msvcrt
        import time

        while True:
            try:
                msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
            except OSError:
                time.sleep(0.1)
            else:
                return

else:

    def _wait_for_lock(handle: int) -> None:
        import fcntl

        # Some network file systems have no locks. Writes are atomic all the same: without the
        # lock, processes at worst fetch the same bytes twice.
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)


def _unwritable(folder: Path, error: OSError) -> AssetError:
    return AssetError(
        f"The mesh cache cannot be written: {folder} ({error.strerror or error}). "
        f"Set {CACHE_VARIABLE} to a folder that can be written and has about 60 MB of space."
    )
