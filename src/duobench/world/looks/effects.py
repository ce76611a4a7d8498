"""Effects on an image after it was rendered: blur, exposure, noise."""

import hashlib
import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from duobench.core.backend import Image
from duobench.core.types import Array
from duobench.world.looks.look import Look

GAMMA = 2.2
"""Exponent from the numbers of an image to light."""
_UNIT_BITS = 8
_UNIT = 1 << _UNIT_BITS
"""Sum of the whole weights of a blur: with 8 bits of brightness they fill 16."""
_STARTS = 1 << 18
"""Places in a long row of random numbers where the noise of an image may begin."""


def apply(
    look: Look, image: Image, time: float, positions: Array, camera: int | str
) -> Image:
    """A rendered image (height, width, 3) as the look's camera takes it.

    Noise is a function of the look's seed and noise, the image's size, the camera's number, or the
    name of one of one's own, and the simulation state (time in seconds and positions), never of
    what was rendered before.
    """
    if look.blur:
        image = _blurred(image, look.blur * image.shape[0])
    if look.exposure:
        image = np.take(_curve(look.exposure), image)
    if look.noise:
        row = _noise(look.seed, look.noise, image.size + _STARTS)
        start = _start(look.seed, time, positions, camera)
        grain = row[start : start + image.size].reshape(image.shape)
        image = np.clip(image + grain, 0, 255).astype(np.uint8)
    return image


def _blurred(image: Image, deviation: float) -> Image:
    """The image, convolved with a Gaussian of a standard deviation in pixels, along each axis."""
    weights = _weights(deviation)
    radius = len(weights) // 2
    for axis in range(
        2 if radius else 0
    ):  # each row is a line along the axis, in memory too
        rows = image.reshape(len(image) if axis else 1, image.shape[axis], -1)
        ends = [np.repeat(rows[:, [end]], radius, axis=1) for end in (0, -1)]
        padded = np.concatenate([ends[0], rows, ends[1]], axis=1).astype(np.uint16)
        padded, step = padded.reshape(len(rows), -1), rows.shape[2]
        total = np.full((len(rows), rows[0].size), _UNIT // 2, dtype=np.uint16)
        for number, weight in enumerate(weights):
            total += padded[:, number * step :][:, : rows[0].size] * weight
        image = (total >> _UNIT_BITS).astype(np.uint8).reshape(image.shape)
    return image


@lru_cache(maxsize=8)
def _weights(deviation: float) -> NDArray[np.uint16]:
    """Weights of a row of pixels, whole numbers that add up to `_UNIT`."""
    radius = math.ceil(2.5 * deviation)
    gauss = np.exp(-0.5 * (np.arange(-radius, radius + 1) / deviation) ** 2)
    weights = np.rint(_UNIT * gauss / gauss.sum()).astype(int)
    weights[radius] += _UNIT - weights.sum()
    return weights[weights > 0].astype(np.uint16)


@lru_cache(maxsize=8)
def _curve(stops: float) -> Image:
    """The new number for each of the 256."""
    return np.clip(np.rint(np.arange(256) * 2 ** (stops / GAMMA)), 0, 255).astype(
        np.uint8
    )


@lru_cache(maxsize=4)
def _noise(
    seed: int,
    deviation: float,
    count: int,
) -> NDArray[np.int16]:
    """A row of Gaussian noise: images take a part of it, since sampling is slow."""
    rng = np.random.Generator(np.random.PCG64([seed, *b"noise"]))
    normal = rng.standard_normal(count, dtype=np.float32)
    return np.rint(255 * deviation * normal).astype(np.int16)


def _start(
    seed: int,
    time: float,
    positions: Array,
    camera: int | str,
) -> int:
    state = hashlib.blake2b(positions.tobytes(), digest_size=8)
    state.update(f"{seed} {time!r} {camera}".encode())
    return int.from_bytes(state.digest(), "big") % _STARTS
