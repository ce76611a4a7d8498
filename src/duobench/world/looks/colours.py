"""Colours by the names that an instruction would use, and shifts that keep the name."""

import colorsys
from collections.abc import Sequence

import numpy as np

RGB = tuple[float, float, float]
"""Red, green and blue, 0 to 1."""

HUE_SHIFT, SATURATION_SHIFT, VALUE_SHIFT = 0.03, 0.25, 0.20
"""Largest shifts of a colour: of the hue in turns, of saturation and value as a share."""
TINT = 0.07
"""Largest saturation that a grey gets."""

_BLACK, _DARK, _LIGHT = 0.20, 0.48, 0.80
"""Values (largest of red, green and blue) below which a colour is black, and dark; and from which
on it is light."""
_GREY = 0.10
"""Difference of the largest and the smallest of red, green and blue below which there is no hue."""
_HUES = (
    (0.035, "red"),
    (0.11, "orange"),
    (0.19, "yellow"),
    (0.46, "green"),
    (0.70, "blue"),
    (0.94, "purple"),
    (1.01, "red"),
)
"""Ends of the ranges of hue, in turns. A dark orange is a brown."""


def colour_name(rgb: Sequence[float]) -> str:
    """What a colour would be called: black, dark grey, light orange, blue, ..."""
    hue, _, value = colorsys.rgb_to_hsv(*rgb)
    if value < _BLACK:
        return "black"
    shade = "dark " if value < _DARK else "light " if value >= _LIGHT else ""
    if max(rgb) - min(rgb) < _GREY:
        return f"{shade}grey"
    return shade + next(name for end, name in _HUES if hue < end)


def shifted(rgb: RGB, amount: float, seed: int) -> RGB:
    """A colour nearby that has the same name; the same seed, the same shift of the same colour.

    The amount is a share of the largest shifts, 0 to 1.
    """
    numbers = [round(1e4 * part) for part in rgb]
    shift = np.random.Generator(np.random.PCG64([seed, *numbers])).uniform(-1, 1, 3)
    hue, saturation, value = colorsys.rgb_to_hsv(*rgb)
    while amount > 0.01:  # noqa: PLR2004 - nothing that anyone would see
        h, s, v = (shift * amount).tolist()
        if max(rgb) - min(rgb) < _GREY:
            around, colourful = h % 1.0, saturation + TINT * abs(s)
        else:
            around, colourful = (hue + HUE_SHIFT * h) % 1.0, saturation * (1 + SATURATION_SHIFT * s)
        bright = min(value * (1 + VALUE_SHIFT * v), 1.0)
        new = colorsys.hsv_to_rgb(around, min(colourful, 1.0), bright)
        if colour_name(new) == colour_name(rgb):
            return new
        amount /= 2
    return rgb
