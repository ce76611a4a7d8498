"""Pictures on surfaces: textures in colours, and image files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import UnidentifiedImageError

from duobench.errors import AssetError
from duobench.scene.look import Material
from duobench.scene.textures import texture

Picture = NDArray[np.uint8]
"""Texels (height, width, 3), red green blue."""


def picture(
    material: Material, shape: tuple[int, int], size: tuple[float, float], seed: int
) -> Picture:
    """What a material shows on a flat surface; a single colour is left to the surface's own.

    Args:
        material: With a texture or an image.
        shape: Height and width in texels.
        size: Height and width of the surface in metres.
        seed: Of the texture.

    Raises:
        AssetError: The image file cannot be read.
    """
    if material.image is not None:
        return _image(material.image, shape)
    if material.texture is None:
        return np.full((*shape, 3), 255, dtype=np.uint8)
    bright = texture(material.texture, shape, size, seed)[..., None]
    if material.colour is not None and material.second_colour is not None:
        low = np.array(material.second_colour, dtype=np.float32)
        texels = low + bright * (np.array(material.colour, dtype=np.float32) - low)
    else:
        texels = np.repeat(1 - material.contrast * (1 - bright), 3, axis=2)
    return np.rint(255 * texels).astype(np.uint8)


def hides_colour(material: Material) -> bool:
    """Whether the colours are in the picture, so that the surface under it is white."""
    return material.image is not None or material.second_colour is not None


def _image(path: str, shape: tuple[int, int]) -> Picture:
    try:
        with Pillow.open(Path(path)) as image:
            height, width = shape
            found = np.asarray(image.convert("RGB").resize((width, height)))
    except (OSError, UnidentifiedImageError) as error:
        raise AssetError(
            f"The look's image {path!r} cannot be read: {error}. It is the path of a PNG or JPEG "
            "file on this machine."
        ) from error
    return found
