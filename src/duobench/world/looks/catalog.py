"""Looks by name: a few that are worth an evaluation of their own, and any number at random."""

import colorsys
import math
import re
from collections.abc import Mapping

import numpy as np

from duobench.core.errors import OptionError, UnknownNameError
from duobench.world.looks.colours import RGB
from duobench.world.looks.look import (
    STUDIO,
    CameraOffset,
    Light,
    Look,
    Material,
)
from duobench.world.robot.cameras import POLICY_CAMERAS
from duobench.world.robot.workcell import SHADOW_CENTRE

DEFAULT = "default"
RANDOM = "random:"
"""Beginning of the name of a random look; a seed follows."""

_KEY = (1.55, 0.0, 2.30)
"""Position of the workcell's light."""
_WINDOW = (-0.8, -2.2, 1.6)

_LOW_SUN = Light(
    position=(0.24, 2.2, 1.7), colour=(0.72, 0.69, 0.64), highlight=0.3, shadow=True
)
_LAMP = Light(
    position=(0.24, -1.6, 2.2), colour=(0.54, 0.45, 0.34), highlight=0.2, shadow=True
)

_OAK = Material(
    colour=(0.66, 0.43, 0.25), texture="wood", second_colour=(0.25, 0.13, 0.06)
)
_PARQUET = Material(
    colour=(0.62, 0.42, 0.25), texture="wood", second_colour=(0.24, 0.13, 0.07)
)
_MARBLE = Material(
    colour=(0.60, 0.63, 0.66), texture="marble", second_colour=(0.22, 0.25, 0.30)
)
_TILES = Material(
    colour=(0.62, 0.55, 0.46), texture="tiles", second_colour=(0.25, 0.21, 0.18)
)
_BRICKS = Material(
    colour=(0.80, 0.74, 0.68), texture="bricks", second_colour=(0.42, 0.17, 0.11)
)
_CHECKER = Material(
    colour=(0.75, 0.62, 0.20), texture="checker", second_colour=(0.28, 0.20, 0.42)
)
_CONCRETE = Material(colour=(0.50, 0.52, 0.50), texture="concrete")

_BOARDS = Material(
    colour=(0.83, 0.62, 0.42), texture="wood", second_colour=(0.50, 0.31, 0.17)
)
_SCREED = Material(colour=(0.62, 0.61, 0.59), texture="concrete", contrast=0.35)
_PLASTER = Material(colour=(0.93, 0.92, 0.89), texture="concrete", contrast=0.06)
_BRUSHED = Material(colour=(0.72, 0.72, 0.73), texture="brushed", contrast=0.5)
_WHITE_PAINT = Material(colour=(0.92, 0.92, 0.91))

_ROOM = {
    "table": _BOARDS,
    "floor": _SCREED,
    "walls": _PLASTER,
    "ceiling": _WHITE_PAINT,
    "metal": _BRUSHED,
}

LOOKS: Mapping[str, Look] = {
    DEFAULT: Look(),
    "bright": Look(
        lights=(
            Light(
                position=_KEY,
                colour=(0.50, 0.50, 0.50),
                highlight=0.3,
                shadow=True,
            ),
            Light(position=_WINDOW, colour=(0.25, 0.25, 0.26)),
        ),
        ambient=(0.52, 0.52, 0.52),
        exposure=0.1,
    ),
    "dark": Look(
        lights=(
            Light(
                position=_KEY, colour=(0.26, 0.25, 0.24), highlight=0.12, shadow=True
            ),
            Light(position=_WINDOW, colour=(0.05, 0.06, 0.08)),
        ),
        ambient=(0.18, 0.18, 0.20),
    ),
    "side_light": Look(lights=(_LOW_SUN,), ambient=(0.24, 0.25, 0.28)),
    "warm_light": Look(lights=(_LAMP,), ambient=(0.44, 0.39, 0.32)),
    "wood_table": Look(parts={"table": _OAK, "floor": _CONCRETE}),
    "marble_table": Look(parts={"table": _MARBLE, "floor": _TILES}),
    "cluttered_background": Look(
        parts={"walls": _BRICKS, "floor": _PARQUET}, clutter=32
    ),
    "distractor_colours": Look(
        parts={
            "table": Material(colour=(0.32, 0.42, 0.52)),
            "floor": _CHECKER,
            "walls": Material(colour=(0.62, 0.30, 0.34)),
            "robot": Material(colour=(0.92, 0.78, 0.62)),
        },
        colour_variation=1.0,
        clutter=12,
    ),
    "textured_objects": Look(
        objects={"*": Material(texture="speckle", contrast=0.45)},
        colour_variation=0.6,
        seed=3,
    ),
    "camera_shift": Look(
        cameras={
            "head": CameraOffset(
                position=(0.03, 0.02, -0.02),
                rotation=(math.radians(-2.5), math.radians(3.0), math.radians(2.0)),
                field_of_view=math.radians(2.5),
            ),
            "left_wrist": CameraOffset(
                position=(0.006, -0.004, 0.004), rotation=(0.03, -0.04, 0.05)
            ),
            "right_wrist": CameraOffset(
                position=(-0.005, 0.005, 0.003), rotation=(-0.03, 0.03, -0.04)
            ),
            "overview": CameraOffset(
                position=(0.05, 0.03, -0.03), rotation=(0.02, 0.02, 0.03)
            ),
        }
    ),
    "noisy": Look(noise=0.045, blur=0.003, exposure=-0.3),
    "studio": Look(renderer=STUDIO, parts=_ROOM),
    "studio_evening": Look(
        renderer=STUDIO,
        parts=_ROOM,
        lights=(
            Light(position=(0.3, -1.9, 1.9), colour=(0.62, 0.50, 0.36), shadow=True),
            Light(position=(2.2, 1.6, 1.2), colour=(0.05, 0.06, 0.09)),
        ),
        ambient=(0.26, 0.26, 0.28),
    ),
}
"""The named looks."""


def names() -> tuple[str, ...]:
    """The names of `LOOKS`; beside them "random:SEED" names a random look of a seed."""
    return tuple(LOOKS)


TABLE_VALUES = (0.34, 0.66)
"""Brightness of a random table: black and white objects stand out from it."""
LIGHT_ELEVATIONS = (math.radians(35.0), math.radians(75.0))
LIGHT_DISTANCE = 2.5
LIGHT_STRENGTHS = (0.34, 0.62)
AMBIENTS = (0.26, 0.50)
"""Ranges of a random look: elevation of the light in radians, its brightness, ambient light."""
CAMERA_SHIFT, CAMERA_TURN = 0.012, math.radians(1.2)
"""Largest offset of a random camera along and about each axis, in metres and radians."""
EXPOSURES, MAX_NOISE, MAX_BLUR = (-0.4, 0.3), 0.02, 0.003
_TABLE_TEXTURES = (None, "wood", "marble", "concrete", "fabric", "speckle")
_FLOOR_TEXTURES = (None, "wood", "tiles", "concrete", "fabric", "checker")
_WALL_TEXTURES = (None, "bricks", "concrete", "stripes", "tiles")
_OBJECT_TEXTURES = (None, None, "concrete", "speckle", "fabric")


def look(name: str) -> Look:
    """A look by its name: one of `LOOKS`, or "random:SEED" for the random look of a seed."""
    if name in LOOKS:
        return LOOKS[name]
    if not name.startswith(RANDOM):
        raise UnknownNameError("look", name, (*LOOKS, f"{RANDOM}SEED"))
    seed = name.removeprefix(RANDOM)
    if not re.fullmatch(r"[0-9]{1,18}", seed):
        raise OptionError(
            f"A random look is named {RANDOM}SEED, as {RANDOM}7; got {name!r}."
        )
    return random_look(int(seed))


def as_look(value: object) -> Look:
    """A look from its name, from its JSON form, or as it is."""
    if isinstance(value, Look):
        return value
    if isinstance(value, str):
        return look(value)
    if isinstance(value, Mapping):
        return Look.from_json(value)
    raise OptionError(f"A look is a name, a Look or its JSON form; got {value!r}.")


def random_look(seed: int) -> Look:
    """A look sampled within the ranges of this module.

    Colours of objects shift within their names, so that an instruction stays true; table, floor,
    walls, lights, cameras and image quality are free within their ranges.
    """
    rng = np.random.Generator(np.random.PCG64([seed, *b"look"]))
    return Look(
        seed=seed,
        parts={
            "table": _material(
                rng,
                _TABLE_TEXTURES,
                TABLE_VALUES,
                contrast=0.4,
            ),
            "floor": _material(
                rng,
                _FLOOR_TEXTURES,
                (0.3, 0.8),
                contrast=0.6,
            ),
            "walls": _material(
                rng,
                _WALL_TEXTURES,
                (0.4, 0.9),
                contrast=0.5,
            ),
            "robot": Material(colour=_colour(rng, (0.0, 0.15), (0.8, 1.0))),
        },
        objects={"*": Material(texture=_choice(rng, _OBJECT_TEXTURES), contrast=0.25)},
        colour_variation=1.0,
        lights=_lights(rng),
        ambient=_tinted(rng, _uniform(rng, *AMBIENTS)),
        clutter=int(rng.integers(0, 17)),
        cameras={name: _offset(rng) for name in POLICY_CAMERAS},
        exposure=_uniform(rng, *EXPOSURES),
        blur=_uniform(rng, 0, MAX_BLUR) if rng.uniform() < 0.5 else 0.0,  # noqa: PLR2004
        noise=_uniform(rng, 0, MAX_NOISE),
    )


def _uniform(
    rng: np.random.Generator,
    low: float,
    high: float,
) -> float:
    return float(rng.uniform(low, high))


def _choice(rng: np.random.Generator, names: tuple[str | None, ...]) -> str | None:
    return names[int(rng.integers(len(names)))]


def _material(
    rng: np.random.Generator,
    textures: tuple[str | None, ...],
    values: tuple[float, float],
    contrast: float,
) -> Material:
    return Material(
        colour=_colour(rng, (0.0, 0.5), values),
        texture=_choice(rng, textures),
        contrast=contrast,
    )


def _colour(
    rng: np.random.Generator,
    saturations: tuple[float, float],
    values: tuple[float, float],
) -> RGB:
    return colorsys.hsv_to_rgb(
        _uniform(rng, 0, 1), _uniform(rng, *saturations), _uniform(rng, *values)
    )


def _tinted(rng: np.random.Generator, brightness: float) -> RGB:
    """Light between warm and cold."""
    warm = 0.12 * _uniform(rng, -1, 1)
    return brightness * (1 + warm), brightness, brightness * (1 - warm)


def _lights(rng: np.random.Generator) -> tuple[Light, ...]:
    """One that casts shadows, from anywhere above, and at most one weak one."""
    # From the front, the back or a side: then one axis of the shadow map has the slope of all
    # level surfaces, and none of them is speckled by its own shadow.
    azimuth = math.pi / 2 * int(rng.integers(4))
    main = Light(
        position=_from(azimuth, _uniform(rng, *LIGHT_ELEVATIONS)),
        colour=_tinted(rng, _uniform(rng, *LIGHT_STRENGTHS)),
        highlight=_uniform(rng, 0, 0.3),
        shadow=True,
    )
    fills = [
        Light(
            position=_from(_uniform(rng, -math.pi, math.pi), _uniform(rng, 0.1, 1.2)),
            colour=_tinted(rng, _uniform(rng, 0.05, 0.18)),
        )
        for _ in range(int(rng.integers(0, 2)))
    ]
    return main, *fills


def _from(azimuth: float, elevation: float) -> tuple[float, float, float]:
    """A place as seen from where lights aim."""
    x, y, z = SHADOW_CENTRE
    across = LIGHT_DISTANCE * math.cos(elevation)
    return (
        x + across * math.cos(azimuth),
        y + across * math.sin(azimuth),
        z + LIGHT_DISTANCE * math.sin(elevation),
    )


def _offset(rng: np.random.Generator) -> CameraOffset:
    x, y, z = rng.uniform(-CAMERA_SHIFT, CAMERA_SHIFT, 3).tolist()
    roll, pitch, yaw = rng.uniform(-CAMERA_TURN, CAMERA_TURN, 3).tolist()
    turn = _uniform(rng, -CAMERA_TURN, CAMERA_TURN)
    return CameraOffset(
        position=(x, y, z), rotation=(roll, pitch, yaw), field_of_view=turn
    )
