"""Geoms that no camera sees, and whose shadows none sees: images come to the same without them."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.types import Array

Booleans = NDArray[np.bool_]
_ONE, _OTHER = np.triu_indices(5, 1)
"""The ten pairs of five planes."""
TEXELS = 4
"""Texels of the shadow map beside what is seen that count as seen; a shadow is blurred over one."""


class Visibility:
    """Boxes around the geoms of a model, which are compared with what cameras see."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._middles = model.geom_aabb[:, :3].copy()
        self._halves = model.geom_aabb[:, 3:].copy()
        self._bounds = model.geom_rbound.copy()  # 0 where there is no bound

    def unseen(
        self,
        data: mujoco.MjData,
        geoms: NDArray[np.int_],
        casting: Booleans,
        frustums: Array,
        light: Array | None,
    ) -> tuple[Booleans, Booleans]:
        """Compare geoms with what cameras see.

        Args:
            data: The state.
            geoms: Ids of geoms (n,); below 0 is anything else, which counts as seen.
            casting: Whether each of them casts a shadow.
            frustums: Planes (c, 5, 4) of each of c cameras, as `frustum` gives them.
            light: Direction (3,) of the light whose shadows count, or None if nothing is known.

        Returns:
            Whether each camera (c, n) sees nothing of a geom, and whether it casts a shadow (n,) of
            which all of them see nothing either.
        """
        model = self._model
        reach = model.vis.map.shadowclip * model.stat.extent
        margin = TEXELS * 2 * reach / model.vis.quality.shadowsize
        turns = data.geom_xmat[geoms].reshape(-1, 3, 3)
        places = data.geom_xpos[geoms]
        middles = places + np.einsum("nij,nj->ni", turns, self._middles[geoms])
        planes = frustums.reshape(-1, 4)
        normals = planes[:, :3]
        along = np.abs(normals @ turns)  # which decides nothing to the bit
        sizes = np.einsum("nk,npk->np", self._halves[geoms], along)
        beyond = (
            np.einsum("ni,pi->np", middles, normals) - planes[:, 3] - sizes - margin
        )
        bounded = ((geoms >= 0) & (self._bounds[geoms] > 0.0))[:, None]
        shape = len(geoms), *frustums.shape[:2]
        is_out = (beyond > 0.0) & bounded
        unseen = is_out.reshape(shape).any(axis=2).T
        unlit = np.zeros(len(geoms), dtype=np.bool_)
        if light is not None and light[2] < 0.0:
            hidden = np.flatnonzero(unseen.all(axis=0) & casting)
            # A shadow ends at the lowest thing there is.
            bottom = float((places[:, 2] - self._bounds[geoms]).min())
            fall = (middles[hidden, 2] - bottom) / -light[2]
            moved = fall[:, None] * (normals * light).sum(axis=1)
            start = beyond[hidden].reshape(-1, *shape[1:])
            unlit[hidden] = _stays_out(start, moved.reshape(start.shape))
        return unseen, unlit


def _stays_out(start: Array, moved: Array) -> Booleans:
    """Whether what moves along a line is beyond one or another of its planes all the way.

    Args:
        start: How far it is beyond each plane (n, c, 5) of c cameras at first, in metres.
        moved: How much further it is in the end.

    Returns:
        Whether it is for all cameras (n,).
    """
    # The distance beyond the farthest plane is least at an end, or where two planes are as far.
    apart = moved[..., _ONE] - moved[..., _OTHER]
    apart[apart == 0.0] = 1.0
    shares = np.zeros((*apart.shape[:2], apart.shape[2] + 2))
    shares[..., 0] = 1.0
    shares[..., 2:] = (start[..., _OTHER] - start[..., _ONE]) / apart
    shares = np.minimum(np.maximum(shares, 0.0), 1.0)
    beyond = np.full(shares.shape, -np.inf)
    for plane in range(start.shape[2]):
        here = start[..., plane, None] + shares * moved[..., plane, None]
        beyond = np.maximum(beyond, here)
    return np.all(beyond > 0.0, axis=(1, 2))


def frustum(lenses: Sequence[mujoco.MjvGLCamera], shape: tuple[int, ...]) -> Array:
    """Planes (5, 4) around what a camera of a scene sees: outward normal, and place along it.

    Normals have a length of 1 to 1.5, as far as a camera sees less than 90 degrees.

    Args:
        lenses: Its two eyes, between which an image is seen.
        shape: Height and width of the image.
    """
    one, other = lenses
    eye = [
        (a + b) / 2 for a, b in zip(one.pos.tolist(), other.pos.tolist(), strict=True)
    ]
    fx, fy, fz = one.forward.tolist()
    ux, uy, uz = one.up.tolist()
    right = fy * uz - fz * uy, fz * ux - fx * uz, fx * uy - fy * ux
    half = one.frustum_width
    half = half or (one.frustum_top - one.frustum_bottom) / 2 * shape[1] / shape[0]
    planes: list[tuple[float, ...]] = []
    for way, (x, y, z), reach in (
        (1.0, right, one.frustum_center + half),
        (-1.0, right, half - one.frustum_center),
        (1.0, (ux, uy, uz), one.frustum_top),
        (-1.0, (ux, uy, uz), -one.frustum_bottom),
        (0.0, right, one.frustum_near),
    ):
        slope = reach / one.frustum_near
        normal = way * x - slope * fx, way * y - slope * fy, way * z - slope * fz
        planes.append((*normal, sum(a * b for a, b in zip(normal, eye, strict=True))))
    return np.array(planes)
