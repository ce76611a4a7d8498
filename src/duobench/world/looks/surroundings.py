"""Light that falls into the workcell from all around, as an image of every direction.

It is made here, read from nowhere: a white ceiling with lamps of some size, walls, and a floor. The
physically based renderer takes it as a file of the format KTX, with a sharp image of each face of a
cube for what is polished, softer ones for what is rough, and nine numbers for what is matt.
"""

import struct
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Vectors = NDArray[np.float32]
"""Directions or colours (..., 3)."""

_SIDE, _LEVELS = 64, 6
"""Pixels along a face of the sharpest image, and the number of images, each half as large."""
_CEILING = (1.00, 0.98, 0.95)
_WALLS = (0.62, 0.64, 0.66)
_FLOOR = (0.34, 0.33, 0.32)
_SHARP = 60.0
"""Concentration of a lamp that reflections on polished metal show."""
_LAMPS = (
    ((0.55, 0.50, 0.80), (9.0, 8.7, 8.2)),
    ((-0.45, 0.60, 0.75), (5.0, 5.0, 5.0)),
    ((0.45, -0.70, 0.60), (4.5, 4.8, 5.2)),
    ((-0.60, -0.45, 0.75), (3.0, 3.0, 3.0)),
)
"""Direction and brightness of each lamp, x y z as in the table frame."""
_RGB = 0x1907
_PACKED = 0x8C3A
"""Three floats without a sign in 32 bits, in the words of OpenGL."""


def image_light() -> bytes:
    """A file of the light from all around."""
    words = "\n".join(" ".join(f"{part:.6f}" for part in row) for row in _matt())
    entry = b"sh\0" + words.encode() + b"\0"
    entry = struct.pack("<I", len(entry)) + entry + b"\0" * (-len(entry) % 4)
    head = b"\xabKTX 11\xbb\r\n\x1a\n" + struct.pack(
        "<13I", 0x04030201, _PACKED, 1, _RGB, _PACKED, _PACKED,
        _SIDE, _SIDE, 0, 0, 6, _LEVELS, len(entry),
    )  # fmt: skip
    return head + entry + b"".join(_images())


def _images() -> Iterator[bytes]:
    """The faces of each level, after their size in bytes."""
    for level in range(_LEVELS):
        side = _SIDE >> level
        roughness = level / (_LEVELS - 1)
        pixels = _packed(_radiance(_directions(side), roughness))
        yield struct.pack("<I", pixels.nbytes // 6) + pixels.tobytes()


def _directions(side: int) -> Vectors:
    """Directions (6, side, side, 3) in the table frame that the pixels of the faces look in."""
    across = ((np.arange(side) + 0.5) / side * 2 - 1).astype(np.float32)
    down, right = np.meshgrid(across, across, indexing="ij")
    one = np.ones_like(right)
    faces = [
        (one, -down, -right),
        (-one, -down, right),
        (right, one, down),
        (right, -one, -down),
        (right, -down, one),
        (-right, -down, -one),
    ]
    x, y, z = np.stack(faces, axis=1)  # of the cube, whose y points up
    length = np.sqrt(x * x + y * y + z * z)
    return np.stack([x, -z, y], axis=-1) / length[..., None]


def _radiance(directions: Vectors, roughness: float) -> Vectors:
    """Light from each direction, as a surface of some roughness mirrors it.

    A lamp is a lobe, and so is the mirror; both together are a wider lobe with the same light.
    """
    up = directions[..., 2:]
    soft = 0.12 + 0.5 * roughness
    above = np.clip(0.5 + (up - 0.45) / (2 * soft), 0, 1)
    below = np.clip(0.5 - (up + 0.30) / (2 * soft), 0, 1)
    walls, ceiling, floor = (
        np.array(c, np.float32) for c in (_WALLS, _CEILING, _FLOOR)
    )
    light = walls + above * (ceiling - walls) + below * (floor - walls)
    mirror = 2.0 / max(roughness, 0.02) ** 4
    width = 1 / (1 / _SHARP + 1 / mirror)
    for direction, brightness in _LAMPS:
        lamp = np.array(direction, np.float32)
        lamp /= np.sqrt(np.sum(lamp * lamp))
        cosine = np.sum(directions * lamp, axis=-1, keepdims=True)
        lobe = width / _SHARP * np.exp(width * (cosine - 1))
        light = light + lobe * np.array(brightness, np.float32)
    return light.astype(np.float32)


def _matt() -> Vectors:
    """Coefficients (9, 3) of the light on a matt surface, by where it faces."""
    seen = _directions(_SIDE).reshape(-1, 3)
    light = _radiance(seen, 0.0).reshape(-1, 3)
    x, y, z = seen[:, 0], seen[:, 2], -seen[:, 1]  # of the cube
    share = np.max(np.abs(seen), axis=1) ** 3  # of the sphere that a pixel covers
    share = share / share.sum()
    basis = (
        (np.ones_like(x), 1.0),
        (y, 2.0),
        (z, 2.0),
        (x, 2.0),
        (x * y, 3.75),
        (y * z, 3.75),
        (3 * z * z - 1, 0.3125),
        (x * z, 3.75),
        (x * x - y * y, 0.9375),
    )
    rows = [
        factor * np.sum((share * values)[:, None] * light, axis=0)
        for values, factor in basis
    ]
    return np.array(rows, dtype=np.float32)


def _packed(colours: Vectors) -> NDArray[np.uint32]:
    """Colours as three floats without a sign, of 11, 11 and 10 bits."""
    bits = colours.astype(np.float16).view(np.uint16).astype(np.uint32)
    red, green, blue = bits[..., 0] >> 4, bits[..., 1] >> 4, bits[..., 2] >> 5
    return (red | green << 11 | blue << 22).astype(np.uint32)
