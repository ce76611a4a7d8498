"""Lights, the camera for people, and colours of geoms, as a browser gets them."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.spatial import matrix_from_wxyz
from duobench.core.types import Array
from duobench.world.looks.look import Light, Look
from duobench.world.robot.cameras import OVERVIEW, OVERVIEW_VIEW, View
from duobench.world.robot.workcell import SHADOW_CENTRE
from duobench.world.sim.appearance import Appearance, Texture

_TARGET_HEIGHT = 0.1
"""The camera turns about what it sees at this height above the table, in metres."""
_DIGITS = 4
_CELLS = 32
"""Most cells of a plane with a texture, along both sides."""
_NO_COLOUR = (0.5, 0.5, 0.5, 1.0)
_RGB = mujoco.mjtTextureRole.mjTEXROLE_RGB.value


def lights_of(model: mujoco.MjModel, look: Look) -> dict[str, Any]:
    """Lights of a model in a look.

    Returns:
        `ambient` (3,); `lights`, each with `direction` (3,) in which it shines, `colour` (3,),
        `highlight`, and `shadow`, whether it casts one; and `shadow`, the `centre` (3,) and the
        half side `reach` in metres of what shadows cover.
    """
    ambient = model.vis.headlight.ambient if look.ambient is None else look.ambient
    if look.lights is None:
        lights = [_light(model, number) for number in range(model.nlight)]
    else:
        lights = [_chosen(light) for light in look.lights]
    reach = float(model.vis.map.shadowclip * model.stat.extent)
    return {
        "ambient": _rounded(np.asarray(ambient)),
        "lights": lights,
        "shadow": {"centre": list(SHADOW_CENTRE), "reach": round(reach, _DIGITS)},
    }


def emission_of(
    model: mujoco.MjModel,
    material: int,
    look: Look,
) -> float:
    """The share of its colour that a geom of a material, -1 for none, shines with by itself."""
    if material < 0:
        return 0.0
    emission = float(model.mat_emission[material])
    if look.ambient is not None:
        emission *= float(np.mean(look.ambient) / np.mean(model.vis.headlight.ambient))
    return emission


def camera_of(model: mujoco.MjModel) -> dict[str, Any]:
    """The camera for people: `eye` (3,), `target` (3,) in metres, `fovy` in degrees."""
    names = [model.camera(number).name for number in range(model.ncam)]
    if OVERVIEW not in names:
        return as_camera(OVERVIEW_VIEW)
    camera = names.index(OVERVIEW)
    eye = np.array(model.cam_pos[camera])
    forward = -matrix_from_wxyz(model.cam_quat[camera])[:, 2]
    distance = (eye[2] - _TARGET_HEIGHT) / -forward[2] if forward[2] < 0 else 1.0
    return {
        "eye": _rounded(eye),
        "target": _rounded(eye + distance * forward),
        "fovy": round(float(model.cam_fovy[camera]), _DIGITS),
    }


def as_camera(view: View) -> dict[str, Any]:
    """A view as the page takes it, like `camera_of`."""
    return {
        "eye": list(view.eye),
        "target": list(view.target),
        "fovy": view.fovy_deg,
    }


def _light(model: mujoco.MjModel, number: int) -> dict[str, Any]:
    return {
        "direction": _rounded(model.light_dir[number]),
        "colour": _rounded(model.light_diffuse[number]),
        "highlight": round(float(np.mean(model.light_specular[number])), _DIGITS),
        "shadow": bool(model.light_castshadow[number]),
    }


def _chosen(light: Light) -> dict[str, Any]:
    direction = np.array(SHADOW_CENTRE) - light.position
    return {
        "direction": _rounded(direction / np.linalg.norm(direction)),
        "colour": list(light.colour),
        "highlight": light.highlight,
        "shadow": light.shadow,
    }


def _rounded(values: Array) -> list[float]:
    return [round(float(value), _DIGITS) for value in values]


def texels_of(
    model: mujoco.MjModel, geom: int, materials: Appearance
) -> Texture | None:
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
    return (
        (1, 1) if texels is None else (_cells(texels.shape[1]), _cells(texels.shape[0]))
    )


def colours_of(
    model: mujoco.MjModel,
    geom: int,
    points: Array,
    materials: Appearance,
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
