"""Pictures for people of images that hold numbers: depth, and the parts that pixels show."""

import colorsys
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow, ImageDraw, ImageFont

Picture = NDArray[np.uint8]
Colour = tuple[int, int, int]
NEAREST, FARTHEST = 0.1, 3.0
"""Depths in metres of the first and the last colour, between which it goes by their logarithm."""
_STOPS = (253, 231, 37), (94, 201, 98), (33, 145, 140), (59, 82, 139), (68, 1, 84)
"""Yellow is near, violet is far [viridis, which people see alike who tell few colours apart]."""
_MARKS = (0.1, 0.2, 0.5, 1.0, 2.0, 3.0)
"""Depths in metres that a legend names."""
_GOLDEN = 0.618034
"""Part of the circle of hues from one number to the next, so that near ones differ."""
_TEXT, _LINE = 12, 18  # pixels


def depth_picture(depth: NDArray[np.floating]) -> Picture:
    """Depth (height, width) in metres in colours (height, width, 3), black where there is none."""
    stops = np.linspace(math.log(NEAREST), math.log(FARTHEST), len(_STOPS))
    logarithms = np.log(np.maximum(depth, NEAREST))
    channels = [
        np.interp(logarithms, stops, each) for each in zip(*_STOPS, strict=True)
    ]
    colours = np.rint(np.stack(channels, axis=-1)).astype(np.uint8)
    return np.where(depth[..., None] > 0.0, colours, np.uint8(0))


def depth_legend() -> dict[str, Colour]:
    """Colours of some depths, by their names."""
    colours = depth_picture(np.array(_MARKS)).tolist()
    marks = {
        f"{mark:g} m": tuple(one) for mark, one in zip(_MARKS, colours, strict=True)
    }
    return {**marks, "not known": (0, 0, 0)}


def segmentation_picture(numbers: NDArray[np.integer]) -> Picture:
    """Numbers of parts (height, width) in colours (height, width, 3), black where there is none."""
    colours = [_colour(number) for number in range(int(numbers.max(initial=0)) + 1)]
    return np.array(colours, dtype=np.uint8)[numbers]


def segmentation_legend(
    numbers: NDArray[np.integer], names: Mapping[str, int]
) -> dict[str, Colour]:
    """Colours of the parts that are shown, by their names."""
    shown = set(np.unique(numbers).tolist())
    return {name: _colour(number) for name, number in names.items() if number in shown}


def pictures(observation: Mapping[str, Any]) -> Iterator[tuple[str, Picture]]:
    """What cameras show in an observation, all as pictures, each with a name for people."""
    yield from observation.get("pixels", {}).items()
    for camera, depth in observation.get("depth", {}).items():
        yield f"{camera} depth", depth_picture(depth)
    for camera, numbers in observation.get("segmentation", {}).items():
        yield f"{camera} segmentation", segmentation_picture(numbers)


def with_legend(picture: Picture, legend: Mapping[str, Colour]) -> Picture:
    """A picture (height, width, 3) above colours and their names."""
    font, width = ImageFont.load_default(_TEXT), picture.shape[1]
    places: dict[str, tuple[int, int]] = {}
    x = y = 0
    for name in legend:
        needed = math.ceil(font.getlength(name)) + 2 * _TEXT
        if x and x + needed > width:
            x, y = 0, y + _LINE
        places[name] = x, y
        x += needed
    strip = Pillow.new("RGB", (width, y + _LINE + 4), (255, 255, 255))
    pen = ImageDraw.Draw(strip)
    for name, (x, y) in places.items():
        pen.rectangle((x + 4, y + 5, x + 14, y + 15), legend[name], (90, 90, 90))
        pen.text((x + 18, y + 3), name, (20, 20, 20), font)
    return np.concatenate([picture, np.asarray(strip)])


def _colour(number: int) -> Colour:
    light = (1.0, 0.75, 0.55)[number % 3] if number else 0.0
    parts = colorsys.hsv_to_rgb(number * _GOLDEN % 1.0, 0.6, light)
    red, green, blue = (round(255 * part) for part in parts)
    return red, green, blue
