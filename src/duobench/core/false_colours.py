"""Pictures for people of images that hold numbers: depth, and the parts that pixels show."""

import colorsys
import math
from collections.abc import Iterator, Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow, ImageDraw, ImageFont

Picture = NDArray[np.uint8]
Legend = Mapping[str, tuple[int, int, int]]
"""Red, green and blue by what they stand for."""
NEAREST, FARTHEST = 0.1, 3.0
"""Depths in metres of the first and the last colour, between which it goes by their logarithm."""
_STOPS = (
    (253, 231, 37),
    (94, 201, 98),
    (33, 145, 140),
    (59, 82, 139),
    (68, 1, 84),
)
"""Yellow is near, violet is far [viridis, which people see alike who tell few colours apart]."""
_MARKS = (0.1, 0.2, 0.5, 1.0, 2.0, 3.0)
"""Depths in metres that a legend names."""
_NOTHING = (0, 0, 0)
_GOLDEN = 0.618034
"""Part of the circle of hues from one number to the next, so that near ones differ."""
_LEVELS = 1024
_TEXT, _GAP = 12, 6  # pixels


def depth_picture(depth: NDArray[np.floating]) -> Picture:
    """Depth (height, width) in metres in colours (height, width, 3), black where there is none."""
    shares = np.log(np.maximum(depth, NEAREST) / NEAREST) / _span()
    places = 1 + np.minimum(shares, 1.0) * (_LEVELS - 1)
    return _ramp()[np.where(depth > 0.0, places, 0).astype(np.intp)]


def depth_legend() -> Legend:
    """Colours of some depths."""
    marks = depth_picture(np.array([_MARKS]))[0].tolist()
    return {
        f"{mark:g} m": tuple(rgb) for mark, rgb in zip(_MARKS, marks, strict=True)
    } | {"not known": _NOTHING}


def segmentation_picture(numbers: NDArray[np.integer]) -> Picture:
    """Numbers of parts (height, width) in colours (height, width, 3), black where there is none."""
    most = int(numbers.max(initial=0))
    colours = np.array([_colour(number) for number in range(most + 1)], dtype=np.uint8)
    return colours[numbers]


def segmentation_legend(
    numbers: NDArray[np.integer], names: Mapping[str, int]
) -> Legend:
    """Colours of the parts that are shown, by their names."""
    shown = set(np.unique(numbers).tolist())
    return {name: _colour(number) for name, number in names.items() if number in shown}


def pictures(
    observation: Mapping[str, Mapping[str, NDArray]],
) -> Iterator[tuple[str, Picture]]:
    """What cameras show in an observation, all as pictures, each with a name for people."""
    kinds = {"depth": depth_picture, "segmentation": segmentation_picture}
    yield from observation.get("pixels", {}).items()
    for kind, picture in kinds.items():
        for camera, image in observation.get(kind, {}).items():
            yield f"{camera} {kind}", picture(image)


def with_legend(picture: Picture, legend: Legend) -> Picture:
    """A picture (height, width, 3) with colours and their names below it, in as many lines."""
    font = ImageFont.load_default(_TEXT)
    width, line = picture.shape[1], _TEXT + _GAP
    places: list[tuple[str, int, int]] = []
    right = top = 0
    for name in legend:
        needed = line + _GAP + math.ceil(font.getlength(name))
        if right and right + needed > width:
            right, top = 0, top + line
        places.append((name, right, top))
        right += needed
    strip = Pillow.new("RGB", (width, top + line + _GAP), (255, 255, 255))
    draw = ImageDraw.Draw(strip)
    for name, x, y in places:
        box = (x + _GAP, y + _GAP, x + line, y + line)
        draw.rectangle(box, fill=legend[name], outline=(90, 90, 90))
        draw.text((x + line + 3, y + _GAP - 1), name, (20, 20, 20), font)
    return np.concatenate([picture, np.asarray(strip)])


def _span() -> float:
    return math.log(FARTHEST / NEAREST)


@lru_cache(maxsize=1)
def _ramp() -> Picture:
    """Colours by depth, after the one of no depth."""
    places = np.linspace(0.0, len(_STOPS) - 1, _LEVELS)
    channels = [
        np.interp(places, range(len(_STOPS)), each)
        for each in zip(*_STOPS, strict=True)
    ]
    return np.vstack([_NOTHING, np.rint(np.column_stack(channels))]).astype(np.uint8)


@lru_cache
def _colour(number: int) -> tuple[int, int, int]:
    if not number:
        return _NOTHING
    light = (1.0, 0.75, 0.55)[number % 3]
    red, green, blue = colorsys.hsv_to_rgb(number * _GOLDEN % 1.0, 0.6, light)
    return round(255 * red), round(255 * green), round(255 * blue)
