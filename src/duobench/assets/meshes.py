"""Robot meshes by logical name: light pictures and small convex hulls, in metres.

    >>> from duobench.assets import meshes
    >>> meshes.visual("fr3/link1")      # picture, a few hundred triangles
    >>> meshes.hull("fr3/link1")        # convex, at most 24 vertices

The first call of a cold cache fetches and converts everything; later ones read one small file.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from duobench.assets import derived, recipes
from duobench.assets.cache import cache_dir, locked
from duobench.assets.geometry import Mesh
from duobench.assets.manifest import MeshFile, manifest
from duobench.assets.progress import shown
from duobench.assets.resolver import read_verified, resolve
from duobench.assets.sources import on_disk
from duobench.errors import UnknownNameError

__all__ = [
    "HULL_NAMES",
    "VISUAL_NAMES",
    "FileStatus",
    "Mesh",
    "hull",
    "prepare",
    "status",
    "visual",
]

VISUAL_NAMES: tuple[str, ...] = tuple(recipes.VISUAL)
"""Names of the picture meshes."""

HULL_NAMES: tuple[str, ...] = tuple(recipes.HULL)
"""Names of the collision hulls."""


@dataclass(frozen=True, kw_only=True, slots=True)
class FileStatus:
    """What is on disk for one file."""

    name: str
    """Logical name of the published file, or "derived meshes" for what was made from all."""
    state: Literal["ready", "missing", "damaged", "different"]
    """Damaged: the bytes are not the expected ones. Different: the derived meshes are usable, but
    this machine's simplifier made others than the reference, so pictures may differ slightly."""
    path: str
    """Where the file lies, or where it is expected if it is missing."""


def visual(name: str) -> Mesh:
    """Return the picture mesh of a link, in the link's own frame.

    Raises:
        UnknownNameError: There is no such mesh; see `VISUAL_NAMES`.
        AssetError: The files it is made from are found nowhere.
    """
    if name not in recipes.VISUAL:
        raise UnknownNameError("visual mesh", name, VISUAL_NAMES)
    return _meshes(derived.path_in(cache_dir())).visual[name]


def hull(name: str) -> Mesh:
    """Return the convex collision hull of a link, in the link's own frame.

    Raises:
        UnknownNameError: There is no such hull; see `HULL_NAMES`.
        AssetError: The files it is made from are found nowhere.
    """
    if name not in recipes.HULL:
        raise UnknownNameError("collision hull", name, HULL_NAMES)
    return _meshes(derived.path_in(cache_dir())).hull[name]


def prepare(progress: bool = True) -> None:
    """Make every mesh ready, so that later calls only read one small file.

    Safe to call from several processes at once: one works, the others wait for it.

    Args:
        progress: Whether downloads are shown on the error stream.

    Raises:
        AssetError: The files are found nowhere, or the cache cannot be written.
    """
    path = derived.path_in(cache_dir())
    if derived.load(path) is None:
        _make(path, progress)


def status() -> list[FileStatus]:
    """Return what is on disk, without fetching or making anything: each file, then the result."""
    rows = [_file_status(file) for file in manifest().files.values()]
    path = derived.path_in(cache_dir())
    meshes = derived.load(path)
    if meshes is None:
        state = "damaged" if path.exists() else "missing"
    else:
        state = "ready" if meshes.digest() == manifest().reference_sha256 else "different"
    return [*rows, FileStatus(name="derived meshes", state=state, path=str(path))]


@functools.cache
def _meshes(path: Path) -> derived.MeshSet:
    """Return all meshes; kept for the life of the process, since the path names the content."""
    return derived.load(path) or _make(path, progress=True)


def _make(path: Path, progress: bool) -> derived.MeshSet:
    with locked(cache_dir()):
        # Whoever held the lock before may have done the work.
        meshes = derived.load(path)
        if meshes is None:
            with shown(progress) as report:
                data = resolve(manifest().files.values(), report)
                meshes = derived.build(data, report)
            derived.save(path, meshes)
    return meshes


def _file_status(file: MeshFile) -> FileStatus:
    places = on_disk(file, cache_dir())
    present = [path for path in places if path.is_file()]
    for path in present:
        if read_verified(path, file) is not None:
            return FileStatus(name=file.name, state="ready", path=str(path))
    if present:
        return FileStatus(name=file.name, state="damaged", path=str(present[0]))
    return FileStatus(name=file.name, state="missing", path=str(places[-1]))
