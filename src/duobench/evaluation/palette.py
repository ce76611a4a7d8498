"""Colours of the stages, the same in every figure and on every page.

Stages are ordered, so their colours are a ramp of rising lightness, from rust where nothing
happened to sand just before the end; success is blue, which no common form of colour blindness
mixes up with either end of the ramp. Wherever the colours appear, the stage's number does too.
"""

from __future__ import annotations

SUCCESS = "#2a6f97"
"""Colour of the last stage."""
_RAMP = ((0x9B, 0x3A, 0x1E), (0xE0, 0x8A, 0x45), (0xF6, 0xDF, 0xB2))
"""Stops of the ramp for the stages before the last, evenly spaced, as RGB."""
DARK_INK, LIGHT_INK = "#000000", "#ffffff"
"""Text on a light and on a dark stage colour."""
_RED, _GREEN, _BLUE = 0.2126, 0.7152, 0.0722
"""Shares of the primaries in relative luminance [WCAG 2.2, ITU-R BT.709]."""
_INK_CHANGE = 0.179
"""Relative luminance at which black and white text have the same contrast, sqrt(1.05 * 0.05) - 0.05
[WCAG 2.2]; at least one of them always has more than 4.5."""


def stage_colours(max_stage: int) -> tuple[str, ...]:
    """Colours of the stages 0, 1, ..., max_stage as `#rrggbb`."""
    failing = [_on_ramp(stage / max(1, max_stage - 1)) for stage in range(max_stage)]
    return (*failing, SUCCESS)


def ink_on(colour: str) -> str:
    """The text colour that is easier to read on a `#rrggbb` colour."""
    red, green, blue = ((int(colour[i : i + 2], 16) / 255) ** 2.2 for i in (1, 3, 5))
    luminance = _RED * red + _GREEN * green + _BLUE * blue
    return DARK_INK if luminance > _INK_CHANGE else LIGHT_INK


def _on_ramp(share: float) -> str:
    """The ramp's colour at 0..1."""
    position = share * (len(_RAMP) - 1)
    index = min(int(position), len(_RAMP) - 2)
    rest = position - index
    mixed = (
        round(low + rest * (high - low))
        for low, high in zip(_RAMP[index], _RAMP[index + 1], strict=True)
    )
    return "#" + "".join(f"{channel:02x}" for channel in mixed)
