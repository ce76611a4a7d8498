"""The one file in which the cache keeps every mesh that was made from the published files."""

from __future__ import annotations

import functools
import hashlib
import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from duobench.assets import recipes
from duobench.assets.cache import write_atomic
from duobench.assets.decimation import Part, decimate, outline
from duobench.assets.geometry import Mesh, from_grid, read, to_grid
from duobench.assets.hulls import convex_hull
from duobench.assets.manifest import manifest
from duobench.assets.progress import Report


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class MeshSet:
    """All derived meshes by name."""

    visual: Mapping[str, Mesh]
    """Picture meshes."""
    hull: Mapping[str, Mesh]
    """Collision hulls."""

    def items(self) -> list[tuple[str, Mesh]]:
        """Return every mesh with a name that says its kind, in one fixed order."""
        pictures = [(f"visual:{name}", self.visual[name]) for name in sorted(self.visual)]
        return pictures + [(f"hull:{name}", self.hull[name]) for name in sorted(self.hull)]

    def digest(self) -> str:
        """Return the SHA-256 of all names, vertices (on the grid) and faces."""
        total = hashlib.sha256()
        for name, mesh in self.items():
            total.update(f"{name} {len(mesh.vertices)} {len(mesh.faces)}\n".encode())
            total.update(to_grid(mesh.vertices).astype("<i8").tobytes())
            total.update(mesh.faces.astype("<i4").tobytes())
        return total.hexdigest()


def build(data: Mapping[str, bytes], report: Report) -> MeshSet:
    """Make every mesh.

    Args:
        data: Bytes of all files of the manifest, by name.
        report: Told how many of the meshes are made.
    """
    visual: dict[str, Mesh] = {}
    for group in recipes.VISUAL_GROUPS:
        report("reducing meshes", len(visual), len(recipes.VISUAL))
        parts = [
            Part(mesh=_read(recipes.VISUAL[name], data), fill=fill_mm * 1e-3)
            for name, fill_mm in group.fills_mm.items()
        ]
        light = decimate(parts, triangles=group.triangles, cell=group.cell_mm * 1e-3)
        visual |= zip(group.fills_mm, light, strict=True)
    for name, vertices in recipes.VISUAL_OUTLINES.items():
        visual[name] = outline(_read(recipes.VISUAL[name], data), vertices)
    report("reducing meshes", len(visual), len(recipes.VISUAL))
    hull = {
        name: convex_hull(_read(file, data).vertices, recipes.HULL_VERTICES)
        for name, file in recipes.HULL.items()
    }
    return MeshSet(visual=visual, hull=hull)


def _read(file: str, data: Mapping[str, bytes]) -> Mesh:
    return read(file, data[file])


@functools.cache
def path_in(cache: Path) -> Path:
    """Return the file's path: its name covers the sources and the recipes."""
    files = {**recipes.VISUAL, **recipes.HULL}
    key = hashlib.sha256(f"{recipes.VERSION} {recipes.HULL_VERTICES}".encode())
    for group in recipes.VISUAL_GROUPS:
        key.update(f"{dict(group.fills_mm)} {group.cell_mm} {group.triangles}".encode())
    key.update(f"{dict(recipes.VISUAL_OUTLINES)}".encode())
    for name, file in files.items():
        key.update(f"{name} {file} {manifest().files[file].sha256}".encode())
    return cache / "derived" / f"meshes-{key.hexdigest()[:16]}.npz"


def save(path: Path, meshes: MeshSet) -> None:
    """Write all meshes into one file, atomically.

    Raises:
        AssetError: The folder cannot be written.
    """
    parts = meshes.items()
    buffer = io.BytesIO()
    np.savez(
        buffer,
        names=np.array([name for name, _ in parts]),
        counts=np.array([(len(m.vertices), len(m.faces)) for _, m in parts]),
        points=np.concatenate([to_grid(m.vertices) for _, m in parts]).astype(np.int32),
        faces=np.concatenate([m.faces for _, m in parts]),
    )
    write_atomic(path, buffer.getvalue())


def load(path: Path) -> MeshSet | None:
    """Read the file, or return None if there is none or it is damaged."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            names, counts = file["names"].tolist(), file["counts"]
            points, faces = file["points"].astype(np.int64), file["faces"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    ends = counts.cumsum(axis=0)
    vertices = from_grid(points)
    kinds: dict[str, dict[str, Mesh]] = {"visual": {}, "hull": {}}
    for name, (n, m), (n_end, m_end) in zip(names, counts.tolist(), ends.tolist(), strict=True):
        kind, _, base = name.partition(":")
        kinds[kind][base] = Mesh(
            vertices=vertices[n_end - n : n_end], faces=faces[m_end - m : m_end]
        )
    return MeshSet(visual=kinds["visual"], hull=kinds["hull"])
