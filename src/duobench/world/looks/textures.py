"""Procedural textures: brightness patterns, seeded, nothing is read from anywhere."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Pattern = NDArray[np.floating[Any]]
"""Brightness (height, width), 0 to 1."""

_BOARD = 0.14
"""Width of a floor board or table plank, in metres."""
_TILE = 0.30
"""Side of a floor tile, in metres."""
_BRICK = (0.075, 0.24)
"""Height and length of a brick with its joint, in metres."""
_JOINT = 0.008
"""Width of a joint between tiles or bricks, in metres."""
_SQUARE = 0.10
"""Side of a square of a chequered surface, in metres."""


def texture(
    name: str, shape: tuple[int, int], size: tuple[float, float], seed: int = 0
) -> Pattern:
    """One of `TEXTURES` over a flat surface: brightness (height, width), 0 to 1.

    The shape is in texels, the size in metres: patterns have their natural size on it.
    """
    rng = np.random.Generator(np.random.PCG64([seed, *name.encode()]))
    return np.clip(TEXTURES[name](_Canvas(shape, size, rng)), 0.0, 1.0).astype(
        np.float32
    )


class _Canvas:
    """A surface to fill: where each texel is, and random numbers on it."""

    def __init__(
        self,
        shape: tuple[int, int],
        size: tuple[float, float],
        rng: np.random.Generator,
    ) -> None:
        self.shape = shape
        self.size = size
        self.rng = rng
        height, width = shape
        self.y = ((np.arange(height, dtype=np.float32) + 0.5) / height * size[0])[
            :, None
        ]
        """Metres from the first row, (height, 1)."""
        self.x = ((np.arange(width, dtype=np.float32) + 0.5) / width * size[1])[None, :]
        """Metres from the first column, (1, width)."""

    def random(
        self,
        low: float,
        high: float,
        shape: int | tuple[int, int],
    ) -> Pattern:
        """Uniform random numbers."""
        return self.rng.uniform(low, high, shape).astype(np.float32)

    def noise(self, grain: tuple[float, float]) -> Pattern:
        """Smooth noise about zero, about -1 to 1, with grains of a height and width in metres."""
        rows = _weights(self.shape[0], self.size[0] / grain[0])
        columns = _weights(self.shape[1], self.size[1] / grain[1])
        cells = self.random(-1, 1, (rows.shape[1], columns.shape[1]))
        return rows @ cells @ columns.T

    def octaves(self, grain: float, count: int) -> Pattern:
        """Noise of several sizes, each half as large and half as strong as the one before."""
        total = np.zeros(self.shape, dtype=np.float32)
        for octave in range(count):
            total += self.noise((grain / 2**octave, grain / 2**octave)) / 2**octave
        return total


def _weights(texels: int, cells: float) -> Pattern:
    """Weights (texels, cells) of a smooth interpolation between the corners of a row of cells."""
    count = max(1, min(round(cells), texels // 2))
    at = (np.arange(texels) + 0.5) / texels * count
    cell = at.astype(int)
    part = at - cell
    part = part * part * (3 - 2 * part)
    weights = np.zeros((texels, count + 1), dtype=np.float32)
    rows = np.arange(texels)
    weights[rows, cell], weights[rows, cell + 1] = 1 - part, part
    return weights


def _wood(canvas: _Canvas) -> Pattern:
    """Planks along the rows, each of its own shade, with streaks and rings."""
    plank = (canvas.y / _BOARD).astype(int).ravel()
    count = int(plank[-1]) + 1
    shade = canvas.random(-0.16, 0.16, count)[plank][:, None]
    streaks = 0.16 * canvas.noise((0.006, 0.6)) + 0.10 * canvas.noise((0.02, 0.3))
    phase = canvas.random(0, 1, count)[plank][:, None]
    rings = 0.07 * np.sin(
        2 * np.pi * (canvas.y + phase + 0.03 * canvas.noise((0.08, 0.5))) / 0.03
    )
    seam = 0.4 * (np.abs(canvas.y / _BOARD % 1.0 - 0.5) > 0.5 - 0.003 / _BOARD)
    return 0.70 + shade + streaks + rings - seam


def _marble(canvas: _Canvas) -> Pattern:
    """Bright stone with thin dark veins."""
    bend = 0.9 * canvas.octaves(0.45, 4)
    veins = 1 - np.abs(np.sin(np.pi * ((canvas.x + 0.6 * canvas.y) / 0.35 + bend)))
    return 0.9 + 0.12 * canvas.octaves(0.25, 3) - 0.75 * veins**5


def _concrete(canvas: _Canvas) -> Pattern:
    """Soft spots of all sizes, and pores."""
    pores = canvas.noise((0.012, 0.012)) > 0.72  # noqa: PLR2004 - a few of the peaks
    return 0.62 + 0.35 * canvas.octaves(0.5, 5) - 0.25 * pores


def _brushed(canvas: _Canvas) -> Pattern:
    """Metal that was brushed along the rows: fine scratches, all one way."""
    scratches = 0.12 * canvas.noise((0.0015, 0.2)) + 0.10 * canvas.noise((0.004, 0.4))
    return 0.80 + scratches


def _fabric(canvas: _Canvas) -> Pattern:
    """A coarse weave."""
    thread = 0.03
    weave = np.sin(2 * np.pi * canvas.x / thread) * np.sin(
        2 * np.pi * canvas.y / thread
    )
    return 0.55 + 0.28 * weave + 0.22 * canvas.octaves(0.2, 3)


def _speckle(canvas: _Canvas) -> Pattern:
    """Chips of stone in a bright ground."""
    chips = np.maximum(canvas.noise((0.024, 0.024)), canvas.noise((0.014, 0.014)))
    return 0.95 - 0.8 * np.clip((chips - 0.62) * 8, 0, 1)


def _tiles(canvas: _Canvas) -> Pattern:
    """Square tiles, each of its own shade, with dark joints."""
    row, column = (canvas.y / _TILE).astype(int), (canvas.x / _TILE).astype(int)
    shade = canvas.random(-0.12, 0.12, (int(row[-1, 0]) + 1, int(column[0, -1]) + 1))
    joint = _edge(canvas.y, _TILE) | _edge(canvas.x, _TILE)
    return 0.82 + shade[row, column] + 0.08 * canvas.octaves(0.3, 3) - 0.6 * joint


def _bricks(canvas: _Canvas) -> Pattern:
    """A brick wall, each row moved by half a brick, with bright joints."""
    height, length = _BRICK
    row = (canvas.y / height).astype(int)
    x = canvas.x + length / 2 * (row % 2)
    column = (x / length).astype(int)
    shade = canvas.random(-0.15, 0.15, (int(row.max()) + 1, int(column.max()) + 1))
    joint = _edge(canvas.y, height) | _edge(x, length)
    return np.where(
        joint, 1.0, 0.42 + shade[row, column] + 0.1 * canvas.octaves(0.1, 2)
    )


def _checker(canvas: _Canvas) -> Pattern:
    """Squares, bright and dark in turn."""
    return ((canvas.y / _SQUARE).astype(int) + (canvas.x / _SQUARE).astype(int)) % 2


def _stripes(canvas: _Canvas) -> Pattern:
    """Stripes across the rows, as wide as the squares."""
    stripes = (canvas.x / _SQUARE).astype(int) % 2
    return np.broadcast_to(stripes, canvas.shape)


def _edge(along: Pattern, period: float) -> NDArray[np.bool_]:
    return along % period < _JOINT


TEXTURES: Mapping[str, Callable[[_Canvas], Pattern]] = {
    "wood": _wood,
    "marble": _marble,
    "concrete": _concrete,
    "brushed": _brushed,
    "fabric": _fabric,
    "speckle": _speckle,
    "tiles": _tiles,
    "bricks": _bricks,
    "checker": _checker,
    "stripes": _stripes,
}
"""Textures by name."""
