"""Lights, and the camera for people, as a browser gets them."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from duobench.looks.look import Light, Look
from duobench.robot.cameras import OVERVIEW, OVERVIEW_VIEW
from duobench.robot.workcell import SHADOW_CENTRE
from duobench.spatial import matrix_from_wxyz
from duobench.types import Array

_TARGET_HEIGHT = 0.1
"""The camera turns about what it sees at this height above the table, in metres."""
_DIGITS = 4


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


def emission_of(model: mujoco.MjModel, material: int, look: Look) -> float:
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
        view = OVERVIEW_VIEW
        return {"eye": list(view.eye), "target": list(view.target), "fovy": view.fovy_deg}
    camera = names.index(OVERVIEW)
    eye = np.array(model.cam_pos[camera])
    forward = -matrix_from_wxyz(model.cam_quat[camera])[:, 2]
    distance = (eye[2] - _TARGET_HEIGHT) / -forward[2] if forward[2] < 0 else 1.0
    return {
        "eye": _rounded(eye),
        "target": _rounded(eye + distance * forward),
        "fovy": round(float(model.cam_fovy[camera]), _DIGITS),
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
