"""What happens to an image after it was rendered: blur, exposure, noise."""

from __future__ import annotations

import hashlib
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import ImageFilter

from duobench.scene.look import Look

Image = NDArray[np.uint8]

GAMMA = 2.2
"""Exponent from the numbers of an image to light."""
_STARTS = 1 << 18
"""Places in a long row of random numbers where the noise of an image may begin."""


def apply(look: Look, image: Image, data: mujoco.MjData, camera: int) -> Image:
    """An image (height, width, 3) as the look's camera takes it.

    Noise is a function of the look's seed and noise, the image's size, the camera's number and
    the simulation state (time and positions), never of what was rendered before.
    """
    if look.blur:
        blur = ImageFilter.GaussianBlur(look.blur * image.shape[0])
        image = np.asarray(Pillow.fromarray(image).filter(blur))
    if look.exposure:
        image = _curve(look.exposure)[image]
    if look.noise:
        row = _noise(look.seed, look.noise, image.size + _STARTS)
        start = _start(look.seed, data, camera)
        grain = row[start : start + image.size].reshape(image.shape)
        image = np.clip(image + grain, 0, 255).astype(np.uint8)
    return image


@lru_cache(maxsize=8)
def _curve(stops: float) -> Image:
    """The new number for each of the 256."""
    return np.clip(np.rint(np.arange(256) * 2 ** (stops / GAMMA)), 0, 255).astype(np.uint8)


@lru_cache(maxsize=4)
def _noise(seed: int, deviation: float, count: int) -> NDArray[np.int16]:
    """A row of Gaussian noise: images take a part of it, since sampling is slow."""
    rng = np.random.Generator(np.random.PCG64([seed, *b"noise"]))
    normal = rng.standard_normal(count, dtype=np.float32)
    return np.rint(255 * deviation * normal).astype(np.int16)


def _start(seed: int, data: mujoco.MjData, camera: int) -> int:
    state = hashlib.blake2b(data.qpos.tobytes(), digest_size=8)
    state.update(f"{seed} {data.time!r} {camera}".encode())
    return int.from_bytes(state.digest(), "big") % _STARTS
