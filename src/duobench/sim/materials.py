"""Which geom of a compiled model has which colour and texture in a look."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from duobench.errors import AssetError, check_known
from duobench.looks.colours import RGB, shifted
from duobench.looks.look import EVERY_OBJECT, Look, Material
from duobench.looks.textures import texture
from duobench.robot.workcell import ROOM_HEIGHT, ROOM_X, ROOM_Y, TABLE_X, TABLE_Y
from duobench.scene.naming import FLOOR, TABLE
from duobench.scene.surfaces import COLLISION_GEOM_GROUP
from duobench.scene.workcell import floor_light, wall_light
from duobench.types import SIDES

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
}
"""Height and width in metres of the texture on each part of the workcell, and texels along both;
3 mm on the table."""
_WHITE = (1.0, 1.0, 1.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class GeomMaterial:
    """What a geom looks like."""

    rgb: RGB | None
    """Colour, or None for the model's."""
    texture: int | None
    """Number of its texture, or None for the model's."""


@dataclass(kw_only=True, slots=True)
class GeomMaterials:
    """What differs from the model."""

    by_geom: dict[int, GeomMaterial] = field(default_factory=dict)
    """By geom id."""
    textures: list[Texture] = field(default_factory=list)
    """Flat ones (n, n, 3), and those of objects (6 n, n, 3): six faces, one below the other."""

    def add(self, texels: Texture) -> int:
        """Add a texture, and return its number."""
        self.textures.append(texels)
        return len(self.textures) - 1


def resolve_materials(model: mujoco.MjModel, look: Look) -> GeomMaterials:
    """Resolve the materials of a look against a model.

    Raises:
        UnknownNameError: The look names an object that the model has not.
        AssetError: An image file cannot be read.
    """
    materials = GeomMaterials()
    colours = [(r, g, b) for r, g, b, _ in model.geom_rgba.tolist()]
    _add_objects(materials, _objects(model), colours, look)
    for part, geoms in _parts(model, colours):
        material = look.parts.get(part)
        if material is not None:
            plain = material.texture is None and material.image is None
            number = None if plain else materials.add(_part_texture(material, part, look.seed))
            rgb = _WHITE if _hides_colour(material) else material.colour
            materials.by_geom |= dict.fromkeys(geoms, GeomMaterial(rgb=rgb, texture=number))
    return materials


def _body(model: mujoco.MjModel, geom: int) -> str:
    return model.body(int(model.geom_bodyid[geom])).name


def _parts(model: mujoco.MjModel, colours: list[RGB]) -> Iterator[tuple[str, list[int]]]:
    """The parts of the workcell and their geoms."""
    for part in (TABLE, FLOOR):
        yield part, [model.geom(part).id]
    for part, material in (("walls", "wall"), ("ceiling", "ceiling")):
        yield part, np.flatnonzero(model.geom_matid == model.material(material).id).tolist()
    white = [geom for geom, colour in enumerate(colours) if colour == _WHITE]
    yield "robot", [geom for geom in white if _body(model, geom).partition("/")[0] in SIDES]


def _objects(model: mujoco.MjModel) -> dict[str, list[int]]:
    """The visible geoms of every part of every object, by the name of the part."""
    objects: dict[str, list[int]] = {}
    for geom in np.flatnonzero(model.geom_group < COLLISION_GEOM_GROUP).tolist():
        name = _body(model, geom)
        if name not in ("world", TABLE, FLOOR) and name.partition("/")[0] not in SIDES:
            objects.setdefault(name, []).append(geom)
    return objects


def _add_objects(
    materials: GeomMaterials, objects: dict[str, list[int]], colours: list[RGB], look: Look
) -> None:
    """Give every visible geom of an object its colour and texture."""
    for name in look.objects:
        if name != EVERY_OBJECT:
            check_known("object", name, objects)
    numbers: dict[str, int | None] = {}
    for name, geoms in objects.items():
        keys = (name, name.partition("/")[0], EVERY_OBJECT)
        key = next((key for key in keys if key in look.objects), "")
        material = look.objects.get(key, Material())
        if key not in numbers:
            plain = material.texture is None and material.image is None
            numbers[key] = None if plain else materials.add(_object_texture(material, look.seed))
        for geom in geoms:
            rgb = _object_colour(colours[geom], colours[geoms[0]], material, look)
            if rgb != colours[geom] or numbers[key] is not None:
                materials.by_geom[geom] = GeomMaterial(rgb=rgb, texture=numbers[key])


def _hides_colour(material: Material) -> bool:
    """Whether the colours are in the texture, so that the surface under it is white."""
    return material.image is not None or material.second_colour is not None


def _object_colour(colour: RGB, main: RGB, material: Material, look: Look) -> RGB:
    """New colour of a geom; a chosen one takes the place of the object's main colour only."""
    if _hides_colour(material):
        return _WHITE
    if material.colour is not None and colour == main:
        return material.colour
    return shifted(colour, look.colour_variation, look.seed)


@lru_cache(maxsize=32)
def _part_texture(material: Material, part: str, seed: int) -> Texture:
    """The texture of a part of the workcell, with the brightness that floor and walls have."""
    size, count = _SURFACES[part]
    texels = _texture(material, count, size, seed)
    if part == "walls":
        texels, light = np.swapaxes(texels, 0, 1), wall_light()  # columns from the ceiling down
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
    return np.vstack([_texture(material, _FACE_TEXELS, size, seed + face) for face in range(6)])


def _texture(material: Material, count: int, size: tuple[float, float], seed: int) -> Texture:
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
