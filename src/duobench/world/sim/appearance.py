"""A look on a compiled model: which geom has which colour and texture, lights, cameras.

The model is not written to, so its physics and the images without a look stay what they are. What
differs is changed in the scene that the engine makes anew for every image.
"""

import math
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from duobench.core.errors import AssetError, check_known
from duobench.core.spatial import rotation_by
from duobench.core.types import SIDES, Array
from duobench.world.looks.clutter import Furniture, pieces
from duobench.world.looks.colours import RGB, shifted
from duobench.world.looks.look import (
    EVERY_OBJECT,
    PARTS,
    STUDIO,
    CameraOffset,
    Light,
    Look,
    Material,
)
from duobench.world.looks.textures import texture
from duobench.world.robot.workcell import (
    ROOM_HEIGHT,
    ROOM_X,
    ROOM_Y,
    SHADOW_CENTRE,
    TABLE_X,
    TABLE_Y,
)
from duobench.world.scene.naming import FLOOR, TABLE
from duobench.world.scene.surfaces import COLLISION_GEOM_GROUP, SHADOWLESS_GEOM_GROUP
from duobench.world.scene.workcell import floor_light, wall_light

Texture = NDArray[np.uint8]
"""Texels (height, width, 3), red green blue."""

_FACE, _FACE_TEXELS = 0.50, 64
"""Side in metres that a texture takes a face of an object for, and its texels: objects are smaller
than what textures are made for, so theirs are finer."""
_ROOM = (ROOM_Y[1] - ROOM_Y[0], ROOM_X[1] - ROOM_X[0])
_SURFACES = {
    "table": ((TABLE_Y[1] - TABLE_Y[0], TABLE_X[1] - TABLE_X[0]), 512),
    "floor": (_ROOM, 384),
    "ceiling": (_ROOM, 128),
    "walls": ((ROOM_HEIGHT, _ROOM[0]), 384),
    "robot": ((_FACE, _FACE), _FACE_TEXELS),
    "metal": ((0.30, 0.30), 256),
}
"""Height and width in metres of the texture on each part of the workcell, and texels along both;
3 mm on the table."""
_FINENESS = {STUDIO: 2}
"""Factor on the texels along a texture, by the renderer."""
_WHITE = (1.0, 1.0, 1.0)
_METAL_GREYS = (0.5, 0.8)
_GREY = 0.05
"""Darkest and brightest grey of metal, and the largest difference of its red, green and blue."""


class GeomMaterial(NamedTuple):
    """Material of a geom."""

    rgb: RGB | None
    """Colour, or None for the model's."""
    texture: int | None
    """Number of its texture, or None for the model's."""


def _body(model: mujoco.MjModel, geom: int) -> str:
    return model.body(int(model.geom_bodyid[geom])).name


def _geoms_of(
    model: mujoco.MjModel,
    part: str,
    colours: list[RGB],
) -> list[int]:
    """The geoms of a part of the workcell."""
    if part in (TABLE, FLOOR):
        return [model.geom(part).id]
    if part == "robot":
        white = [geom for geom, colour in enumerate(colours) if colour == _WHITE]
        return [geom for geom in white if _body(model, geom).partition("/")[0] in SIDES]
    if part == "metal":
        return [
            geom
            for geom, colour in enumerate(colours)
            if _is_metal(colour)
            and model.geom_group[geom] < COLLISION_GEOM_GROUP
            and _is_fixed_or_robot(model, geom)
        ]
    material = model.material("wall" if part == "walls" else part).id
    return np.flatnonzero(model.geom_matid == material).tolist()


def _is_metal(colour: RGB) -> bool:
    """Whether it is the grey of bare metal, where mount and robot have it."""
    low, high = _METAL_GREYS
    return low < min(colour) and max(colour) < high and np.ptp(colour) < _GREY


def _is_fixed_or_robot(model: mujoco.MjModel, geom: int) -> bool:
    name = _body(model, geom)
    if name.partition("/")[0] in SIDES:
        return True
    return name == "world" and model.geom_group[geom] != SHADOWLESS_GEOM_GROUP


def parts_of(model: mujoco.MjModel) -> dict[str, list[int]]:
    """The geoms of each part of the workcell, by `PARTS`."""
    colours = _colours(model)
    return {part: _geoms_of(model, part, colours) for part in PARTS}


def _colours(model: mujoco.MjModel) -> list[RGB]:
    return [(red, green, blue) for red, green, blue, _ in model.geom_rgba.tolist()]


def _objects(model: mujoco.MjModel) -> dict[str, list[int]]:
    """The visible geoms of every part of every object, by the name of the part."""
    objects: dict[str, list[int]] = {}
    for geom in np.flatnonzero(model.geom_group < COLLISION_GEOM_GROUP).tolist():
        name = _body(model, geom)
        if name not in ("world", TABLE, FLOOR) and name.partition("/")[0] not in SIDES:
            objects.setdefault(name, []).append(geom)
    return objects


def _hides_colour(material: Material) -> bool:
    """Whether the colours are in the texture, so that the surface under it is white."""
    return material.image is not None or material.second_colour is not None


def _object_colour(
    colour: RGB,
    main: RGB,
    material: Material,
    look: Look,
) -> RGB:
    """New colour of a geom; a chosen one takes the place of the object's main colour only."""
    if _hides_colour(material):
        return _WHITE
    if material.colour is not None and colour == main:
        return material.colour
    return shifted(colour, look.colour_variation, look.seed)


@lru_cache(maxsize=32)
def _part_texture(
    material: Material,
    part: str,
    seed: int,
    fineness: int,
) -> Texture:
    """The texture of a part of the workcell, with the brightness that floor and walls have."""
    size, count = _SURFACES[part]
    count *= fineness
    texels = _texture(material, count, size, seed)
    if part == "walls":
        texels, light = (
            np.swapaxes(texels, 0, 1),
            wall_light(),
        )  # columns from the ceiling down
    elif part == "floor":
        light = floor_light()
    else:
        return texels
    rows, columns = (np.arange(count) * length // count for length in light.shape)
    shade = light[np.ix_(rows, columns)].astype(np.float32)
    return np.rint(texels * shade[..., None]).astype(np.uint8)


@lru_cache(maxsize=32)
def _object_texture(material: Material, seed: int) -> Texture:
    size = _FACE, _FACE
    return np.vstack(
        [_texture(material, _FACE_TEXELS, size, seed + face) for face in range(6)]
    )


def _texture(
    material: Material, count: int, size: tuple[float, float], seed: int
) -> Texture:
    """The texture or image of a material, `count` texels along both, on a surface in metres."""
    if material.image is not None:
        return _image(material.image, count)
    assert material.texture is not None  # without either there is nothing to show
    bright = texture(material.texture, (count, count), size, seed)[..., None]
    if material.colour is not None and material.second_colour is not None:
        low = np.array(material.second_colour, dtype=np.float32)
        texels = low + bright * (np.array(material.colour, dtype=np.float32) - low)
    else:
        texels = np.repeat(1 - material.contrast * (1 - bright), 3, axis=2)
    return np.rint(255 * texels).astype(np.uint8)


def _image(path: str, count: int) -> Texture:
    try:
        with Pillow.open(Path(path)) as image:
            return np.asarray(image.convert("RGB").resize((count, count)))
    except OSError as error:
        raise AssetError(
            f"The look's image {path!r} cannot be read: {error}. It is the path of a PNG or JPEG "
            "file on this machine."
        ) from error


_DECOR = mujoco.mjtCatBit.mjCAT_DECOR.value
_LIGHT_DISTANCE = 2.7
"""Distance from a light to the middle of the shadow map in metres, as in the workcell."""


class Appearance:
    """A look, resolved against a model once."""

    def __init__(self, model: mujoco.MjModel, look: Look) -> None:
        self.look = look
        self.textures: list[Texture] = []
        """Textures of the materials after those of the model; see `sim.offscreen.upload`. Flat ones
        (n, n, 3), and those of objects (6 n, n, 3): six faces, one below the other."""
        self.by_geom: dict[int, GeomMaterial] = {}
        """Materials that differ from the model, by geom id."""
        colours = _colours(model)
        self._add_objects(_objects(model), colours)
        for part in PARTS:
            material = look.parts.get(part)
            if material:
                number = self._add(material, part)
                rgb = _WHITE if _hides_colour(material) else material.colour
                geoms = _geoms_of(model, part, colours)
                self.by_geom |= dict.fromkeys(geoms, GeomMaterial(rgb, number))
        self.pieces = [_as_geom(piece) for piece in pieces(look.clutter, look.seed)]
        self._first_material, self._first_texture = model.nmat, model.ntex
        self._cameras = {
            model.camera(name).id: offset for name, offset in look.cameras.items()
        }
        ambient = np.mean(model.vis.headlight.ambient)
        self.ambient_share = (
            None if look.ambient is None else float(np.mean(look.ambient) / ambient)
        )

    def _add_objects(self, objects: dict[str, list[int]], colours: list[RGB]) -> None:
        """Give every visible geom of an object its colour and texture."""
        look = self.look
        for name in look.objects:
            if name != EVERY_OBJECT:
                check_known("object", name, objects)
        numbers: dict[str, int | None] = {}
        for name, geoms in objects.items():
            keys = (name, name.partition("/")[0], EVERY_OBJECT)
            key = next((key for key in keys if key in look.objects), "")
            material = look.objects.get(key, Material())
            if key not in numbers:
                numbers[key] = self._add(material, None)
            for geom in geoms:
                rgb = _object_colour(colours[geom], colours[geoms[0]], material, look)
                if rgb != colours[geom] or numbers[key] is not None:
                    self.by_geom[geom] = GeomMaterial(rgb, numbers[key])

    def _add(self, material: Material, part: str | None) -> int | None:
        """Add what a material shows on a part of the workcell or an object; its number, if any."""
        if material.texture is None and material.image is None:
            return None
        seed = self.look.seed
        texels = (
            _part_texture(material, part, seed, _FINENESS.get(self.look.renderer, 1))
            if part
            else _object_texture(material, seed)
        )
        self.textures.append(texels)
        return len(self.textures) - 1

    def aim(self, scene: mujoco.MjvScene, camera: int) -> None:
        """Move the lenses of a scene that the engine has just put where a camera is."""
        for lens in scene.camera:
            self.aim_lens(lens, camera)

    def aim_lens(self, lens: mujoco.MjvGLCamera, camera: int) -> None:
        """Move a lens that is where a camera is."""
        offset = self._cameras.get(camera)
        if offset:
            _move(lens, offset)

    def apply(self, scene: mujoco.MjvScene, geoms: tuple[mujoco.MjvGeom, ...]) -> None:
        """Change a scene that the engine has just made, all but its shapes and where they are.

        Its geoms have room for the furniture.
        """
        if self.look.lights is not None:
            _light(scene, self.look.lights)
        if self.look.ambient is not None:
            scene.lights[0].ambient[:] = self.look.ambient
        for geom in geoms[: scene.ngeom]:
            material = self.by_geom.get(geom.objid)
            if material is not None and material.rgb is not None:
                geom.rgba[:3] = material.rgb
            if material is not None and material.texture is not None:
                geom.matid = self._first_material + material.texture
                geom.texid = self._first_texture + material.texture
                # A mesh may have coordinates for a texture of its own.
                geom.texcoord = 0
            if self.ambient_share is not None:
                geom.emission *= self.ambient_share
        for piece in self.pieces:
            geom = geoms[scene.ngeom]
            mujoco.mjv_initGeom(geom, *piece)
            # The engine leaves these as they were in the memory.
            geom.objtype = 0
            geom.objid = -1
            geom.segid = -1
            geom.dataid = -1
            geom.texid = -1
            geom.transparent = 0
            geom.category = _DECOR  # which casts no shadow
            scene.ngeom += 1


def _as_geom(piece: Furniture) -> tuple[int, Array, Array, Array, NDArray[np.float32]]:
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
        light.type = model.type
        light.id = model.id
        light.texid = -1
        light.exponent = 0.0
        light.cutoff = model.cutoff
        light.attenuation[:] = model.attenuation
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
