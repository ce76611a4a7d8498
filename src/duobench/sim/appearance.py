"""A look on a compiled model: which geom has which colour and texture, lights, cameras.

The model is not written to, so its physics and the images without a look stay what they are. What
differs is changed in the scene that the engine makes anew for every image.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.looks.clutter import Piece, pieces
from duobench.looks.look import CameraOffset, Light, Look
from duobench.robot.workcell import SHADOW_CENTRE
from duobench.sim.materials import resolve_materials
from duobench.spatial import rotation_by
from duobench.types import Array

_DECOR = mujoco.mjtCatBit.mjCAT_DECOR.value
_LIGHT_DISTANCE = 2.7
"""From a light to the middle of the shadow map in metres, as the workcell's own."""


class Appearance:
    """A look, resolved against a model once."""

    def __init__(self, model: mujoco.MjModel, look: Look) -> None:
        """Resolve every name, and make the textures.

        Raises:
            UnknownNameError: The look names an object that the model has not.
            AssetError: An image file cannot be read.
        """
        self.look = look
        materials = resolve_materials(model, look)
        self.textures = materials.textures
        """What the materials after those of the model show; see `sim.uploads`."""
        self._by_geom = materials.by_geom
        self._pieces = [_as_geom(piece) for piece in pieces(look.clutter, look.seed)]
        self._first_material, self._first_texture = model.nmat, model.ntex
        self._cameras = {model.camera(name).id: offset for name, offset in look.cameras.items()}
        ambient = np.mean(model.vis.headlight.ambient)
        self._emission = None if look.ambient is None else float(np.mean(look.ambient) / ambient)

    def apply(self, scene: mujoco.MjvScene, geoms: tuple[mujoco.MjvGeom, ...], camera: int) -> None:
        """Change a scene that the engine has just made, all but its shapes and where they are.

        Args:
            scene: The scene.
            geoms: Its geoms, with room for the furniture.
            camera: The camera that looks at it.
        """
        if offset := self._cameras.get(camera):
            for lens in scene.camera:
                _move(lens, offset)
        if self.look.lights is not None:
            _light(scene, self.look.lights)
        if self.look.ambient is not None:
            scene.lights[0].ambient[:] = self.look.ambient
        for geom in geoms[: scene.ngeom]:
            material = self._by_geom.get(geom.objid)
            if material is not None and material.rgb is not None:
                geom.rgba[:3] = material.rgb
            if material is not None and material.texture is not None:
                geom.matid = self._first_material + material.texture
                geom.texid = self._first_texture + material.texture
            if self._emission is not None:
                geom.emission *= self._emission
        for piece in self._pieces:
            geom = geoms[scene.ngeom]
            mujoco.mjv_initGeom(geom, *piece)
            # The engine leaves these as they were in the memory.
            geom.objtype, geom.objid, geom.segid, geom.dataid, geom.texid = 0, -1, -1, -1, -1
            geom.transparent = 0
            geom.category = _DECOR  # which casts no shadow
            scene.ngeom += 1


def _as_geom(piece: Piece) -> tuple[int, Array, Array, Array, NDArray[np.float32]]:
    """Type, size, position, rotation and colour of a piece of furniture, as the engine wants it."""
    x, y, z = (length / 2 for length in piece.size)
    kind, size = mujoco.mjtGeom.mjGEOM_BOX, (x, y, z)
    if piece.is_round:
        kind, size = mujoco.mjtGeom.mjGEOM_CYLINDER, (x, z, 0.0)
    rgba = np.array([*piece.colour, 1.0], dtype=np.float32)
    return kind.value, np.array(size), np.array(piece.position), np.eye(3).ravel(), rgba


def _light(scene: mujoco.MjvScene, lights: tuple[Light, ...]) -> None:
    """Put lights in the place of the model's; the first of the scene is the ambient light."""
    model = scene.lights[1]
    for light, chosen in zip(scene.lights[1:], lights, strict=False):
        direction = np.array(SHADOW_CENTRE) - chosen.position
        direction /= np.linalg.norm(direction)
        light.headlight = 0
        light.type, light.id, light.texid = model.type, model.id, -1
        light.exponent, light.cutoff, light.attenuation[:] = 0.0, model.cutoff, model.attenuation
        light.ambient[:] = 0.0
        light.pos[:] = SHADOW_CENTRE - _LIGHT_DISTANCE * direction
        light.dir[:] = direction
        light.diffuse[:] = chosen.colour
        light.specular[:] = chosen.highlight
        light.castshadow = chosen.shadow
    scene.nlight = 1 + len(lights)


def _move(lens: mujoco.MjvGLCamera, offset: CameraOffset) -> None:
    """Move, turn and zoom a camera of the scene."""
    back, up = -lens.forward.astype(np.float64), lens.up.astype(np.float64)
    axes = np.column_stack([np.cross(up, back), up, back])
    turned = axes @ rotation_by(offset.rotation)
    lens.pos[:] += axes @ offset.position
    lens.forward[:], lens.up[:] = -turned[:, 2], turned[:, 1]
    near = lens.frustum_near
    half = math.atan(lens.frustum_top / near)
    zoom = math.tan(half + offset.field_of_view / 2) / math.tan(half)
    for name in ("center", "width", "bottom", "top"):
        field = f"frustum_{name}"
        setattr(lens, field, zoom * getattr(lens, field))
