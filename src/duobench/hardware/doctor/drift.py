"""Whether a camera has been moved: its image compared with one that was stored before.

The image is cut into tiles, each is compared by phase correlation, and the middle of all shifts is
taken, so that arms and objects that are elsewhere today do not matter as long as most of the image
shows what it showed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from duobench.backend import Image
from duobench.errors import OptionError
from duobench.types import Array

TILE = 160
"""Edge of a tile in pixels."""
FEWEST_TILES = 6
"""Tiles that have to agree with themselves for a shift to be told."""
DISTINCT = 3.0
"""Contrast in counts that a tile needs."""
_AGREE = 0.12
"""Height of the peak of a tile that shows the same thing."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Shift:
    """How far an image is from another one."""

    right: float
    """Pixels to the right, in the middle of the tiles."""
    down: float
    """Pixels down."""
    tiles: int
    """Tiles that show the same in both."""

    @property
    def pixels(self) -> float:
        """Its length in pixels."""
        return float(np.hypot(self.right, self.down))


def shift_between(image: Image, reference: Image) -> Shift | None:
    """How far the content of an image is from where it is in a reference.

    Args:
        image: An image (height, width, 3).
        reference: Another one of that size.

    Returns:
        The shift; None where too little of both is alike.

    Raises:
        OptionError: The sizes differ, or are smaller than a few tiles.
    """
    if image.shape != reference.shape:
        raise OptionError(f"Images of {image.shape} and {reference.shape} cannot be compared.")
    now, before = _grey(image), _grey(reference)
    window = np.outer(np.hanning(TILE), np.hanning(TILE))
    shifts: list[tuple[float, float]] = []
    for top in range(0, now.shape[0] - TILE + 1, TILE // 2):
        for left in range(0, now.shape[1] - TILE + 1, TILE // 2):
            part = slice(top, top + TILE), slice(left, left + TILE)
            if before[part].std() > DISTINCT and now[part].std() > DISTINCT:
                shift = _tile_shift(now[part] * window, before[part] * window)
                if shift is not None:
                    shifts.append(shift)
    if len(shifts) < FEWEST_TILES:
        return None
    down, right = np.median(np.array(shifts), axis=0)
    return Shift(right=float(right), down=float(down), tiles=len(shifts))


def _grey(image: Image) -> Array:
    grey = image.astype(np.float64).mean(axis=-1)
    return grey - grey.mean()


def _tile_shift(now: Array, before: Array) -> tuple[float, float] | None:
    cross = np.fft.rfft2(now - now.mean()) * np.conj(np.fft.rfft2(before - before.mean()))
    surface = np.fft.irfft2(cross / np.maximum(np.abs(cross), 1e-9), s=now.shape)
    peak = np.unravel_index(int(surface.argmax()), surface.shape)
    near = np.array(
        [
            [surface[(peak[0] + y) % TILE, (peak[1] + x) % TILE] for x in (-1, 0, 1)]
            for y in (-1, 0, 1)
        ]
    )
    if near.clip(0.0).sum() < _AGREE:
        return None
    weights = near.clip(0.0)
    offset = np.array([-1.0, 0.0, 1.0])
    down = peak[0] + float((weights.sum(axis=1) * offset).sum() / weights.sum())
    right = peak[1] + float((weights.sum(axis=0) * offset).sum() / weights.sum())
    return _signed(down), _signed(right)


def _signed(shift: float) -> float:
    return shift - TILE if shift > TILE / 2 else shift
