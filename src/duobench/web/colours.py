"""Colours of the geoms of a model: a texture counts by its mean."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.sim.appearance import GeomMaterials, Texture
from duobench.types import Array

_CELLS = 32
"""Most cells of a plane with a texture, along both sides."""
_NO_COLOUR = (0.5, 0.5, 0.5, 1.0)
_RGB = mujoco.mjtTextureRole.mjTEXROLE_RGB.value


def texels_of(model: mujoco.MjModel, geom: int, materials: GeomMaterials) -> Texture | None:
    """The texture (height, width, 3) of a geom, if it has one."""
    changed = materials.by_geom.get(geom)
    if changed is not None and changed.texture is not None:
        return materials.textures[changed.texture]
    material = int(model.geom_matid[geom])
    texture = int(model.mat_texid[material, _RGB]) if material >= 0 else -1
    if texture < 0:
        return None
    height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
    channels = int(model.tex_nchannel[texture])
    start = int(model.tex_adr[texture])
    texels = model.tex_data[start : start + height * width * channels]
    return texels.reshape(height, width, channels)[..., :3]


def cells_for(texels: Texture | None) -> tuple[int, int]:
    """Into how many cells along x and y a plane with a texture is cut."""
    return (1, 1) if texels is None else (_cells(texels.shape[1]), _cells(texels.shape[0]))


def colours_of(
    model: mujoco.MjModel,
    geom: int,
    points: Array,
    materials: GeomMaterials,
    texels: Texture | None,
) -> Array:
    """Colours (n, 3) of a geom at points (n, 3) in its frame.

    A texture counts by its mean; on a plane, by its mean around each point.
    """
    rgb = _rgb(model, geom)
    changed = materials.by_geom.get(geom)
    if changed is not None and changed.rgb is not None:
        rgb = np.array(changed.rgb)
    if texels is None:
        return np.broadcast_to(rgb, points.shape)
    if int(model.geom_type[geom]) != mujoco.mjtGeom.mjGEOM_PLANE:
        return np.broadcast_to(rgb * _mean(texels), points.shape)
    half = np.abs(points[:, :2]).max(axis=0)
    height, width = texels.shape[:2]
    across, along = ((points[:, :2] / half + 1) / 2).T
    means = [
        _mean(texels[_around(v, height)][:, _around(u, width)])
        for u, v in zip(across.tolist(), along.tolist(), strict=True)
    ]
    return rgb * np.array(means)


def _rgb(model: mujoco.MjModel, geom: int) -> Array:
    """The colour (3,) of a geom: its own, or its material's where it has none [MuJoCo]."""
    material = int(model.geom_matid[geom])
    has_own = material < 0 or not np.array_equal(model.geom_rgba[geom], _NO_COLOUR)
    rgba = model.geom_rgba[geom] if has_own else model.mat_rgba[material]
    return rgba[:3].astype(np.float64)


def _cells(count: int) -> int:
    """Cells of a plane along a side of its texture, which has a count of texels there."""
    return min(count, _CELLS)


def _around(place: float, count: int) -> slice:
    """The texels of a row or column that lie within half a cell of a plane around a place."""
    half = 1 / (2 * _cells(count))
    first = int(np.clip((place - half) * count, 0, count - 1))
    return slice(first, max(first + 1, int(np.ceil(min(place + half, 1.0) * count))))


def _mean(texels: NDArray[np.uint8]) -> Array:
    return texels.reshape(-1, texels.shape[-1]).mean(axis=0) / 255
