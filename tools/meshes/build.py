"""From the published files to the bytes of the one file that the package ships."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping

import numpy as np

from duobench.objects import Mesh
from tools.meshes import recipes
from tools.meshes.decimation import Part, decimate, outline
from tools.meshes.geometry import read, to_grid
from tools.meshes.hulls import convex_hull

_DATE = (1980, 1, 1, 0, 0, 0)
"""Date of every member of the file: the earliest that the format knows."""
_UNIX = 3
"""Where every member says that it was made."""


def build(originals: Mapping[str, bytes]) -> dict[str, Mesh]:
    """Make every mesh.

    Args:
        originals: Bytes of all published files by name.

    Returns:
        The meshes by name, each with the suffix ":visual" or ":hull".
    """
    visual: dict[str, Mesh] = {}
    for group in recipes.VISUAL_GROUPS:
        parts = [
            Part(mesh=_read(recipes.VISUAL[name], originals), fill=fill_mm * 1e-3)
            for name, fill_mm in group.fills_mm.items()
        ]
        light = decimate(parts, triangles=group.triangles, cell=group.cell_mm * 1e-3)
        visual |= zip(group.fills_mm, light, strict=True)
    for name, vertices in recipes.VISUAL_OUTLINES.items():
        visual[name] = outline(_read(recipes.VISUAL[name], originals), vertices)
    hulls = {
        name: convex_hull(_read(file, originals).vertices, recipes.HULL_VERTICES)
        for name, file in recipes.HULL.items()
    }
    return {
        **{f"{name}:visual": mesh for name, mesh in visual.items()},
        **{f"{name}:hull": mesh for name, mesh in hulls.items()},
    }


def encode(meshes: Mapping[str, Mesh]) -> bytes:
    """Return the bytes of the file, which depend on the meshes alone.

    Nothing is compressed, because compressors differ from one version to the next.
    """
    names = sorted(meshes)
    ordered = [meshes[name] for name in names]
    arrays = {
        "names": np.array(names),
        "counts": np.array([(len(m.vertices), len(m.faces)) for m in ordered], "<i4"),
        "points": np.concatenate([to_grid(m.vertices) for m in ordered]).astype("<i4"),
        "faces": np.concatenate([m.faces for m in ordered]).astype("<i4"),
    }
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, array, version=(1, 0), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", _DATE)
            info.create_system = _UNIX
            archive.writestr(info, member.getvalue())
    return buffer.getvalue()


def _read(file: str, originals: Mapping[str, bytes]) -> Mesh:
    return read(file, originals[file])
