"""Looks: how a scene is rendered, as a value.

A look changes colours, textures, lights, background, cameras and what happens to an image after it
was rendered. It changes nothing that the physics knows, and it is switched, not compiled. What is
left at its default stays as the scene was composed, so `Look()` is the scene itself.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Self

import msgspec

from duobench.core.errors import OptionError, check_known
from duobench.core.settings import decode
from duobench.world.looks.colours import RGB
from duobench.world.looks.textures import TEXTURES
from duobench.world.robot.cameras import OVERVIEW, POLICY_CAMERAS

CLASSIC, STUDIO = "classic", "studio"
RENDERERS = (CLASSIC, STUDIO)
"""What renders the images: MuJoCo's OpenGL renderer, or its physically based one, by Vulkan."""
PARTS = ("table", "floor", "walls", "ceiling", "robot", "metal")
"""Parts of the workcell whose material a look may choose. Of the robot it is that of the white
covers; joints and cameras keep theirs. The metal is that of the mount and of the grippers."""
EVERY_OBJECT = "*"
"""Stands for every object that a look does not name."""
MAX_LIGHTS = 6
"""OpenGL has eight lights, and one of them carries the ambient light."""
MAX_CLUTTER = 40
"""Most pieces of furniture along the walls."""
MAX_FIELD_OF_VIEW_OFFSET = math.radians(20.0)
"""A vertical field of view has to stay one."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Material:
    """Colour and texture of a part of the workcell, or of an object."""

    colour: RGB | None = None
    """Colour, 0 to 1; None keeps it."""
    texture: str | None = None
    """One of `duobench.world.looks.textures.TEXTURES`; None is plain."""
    second_colour: RGB | None = None
    """Colour of the dark parts of the texture; None takes a darker shade of the first."""
    contrast: float = 0.35
    """Darkness of that shade, 0 to 1."""
    image: str | None = None
    """Path of an image file that takes the place of the texture."""

    def __post_init__(self) -> None:
        _check_colour("colour", self.colour)
        _check_colour("second_colour", self.second_colour)
        _check_range("contrast", self.contrast, 0.0, 1.0)
        if self.texture is not None:
            check_known("texture", self.texture, TEXTURES)
        if self.texture is not None and self.image is not None:
            raise OptionError(
                f"A material has a texture or an image, got {self.texture!r} and {self.image!r}."
            )
        if self.second_colour is not None and (
            self.colour is None or self.texture is None
        ):
            raise OptionError("A second colour needs a texture and a first colour.")


@dataclass(frozen=True, kw_only=True, slots=True)
class Light:
    """A distant light that shines at the middle of the workcell."""

    position: tuple[float, float, float]
    """Position in the table frame, in metres; only the direction matters. Straight from the
    front, the back or a side (y or x of `SHADOW_CENTRE`) no level surface is speckled by its own
    shadow."""
    colour: RGB = (0.45, 0.44, 0.42)
    """Brightness of a white surface that faces it; added up over all lights."""
    highlight: float = 0.0
    """Brightness of its reflections on what shines, 0 to 1."""
    shadow: bool = False
    """Whether it casts shadows; at most one light of a look does."""

    def __post_init__(self) -> None:
        _check_colour("colour", self.colour)
        _check_range("highlight", self.highlight, 0.0, 1.0)
        if not _is_vector(self.position) or math.hypot(*self.position) < 1.0:
            raise OptionError(
                f"A light stands at x y z, at least 1 m away from the origin; got {self.position}."
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class CameraOffset:
    """Offset of a camera from its nominal pose, in its own frame.

    The frame is MuJoCo's: x right in the image, y up, z towards the viewer.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Metres."""
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector in radians: axis times angle."""
    field_of_view: float = 0.0
    """Added to the vertical field of view, in radians."""

    def __post_init__(self) -> None:
        if not (_is_vector(self.position) and _is_vector(self.rotation)):
            raise OptionError(
                f"The offset of a camera is three finite numbers each, got {self}."
            )
        limit = MAX_FIELD_OF_VIEW_OFFSET
        _check_range("field_of_view", self.field_of_view, -limit, limit)


@dataclass(frozen=True, kw_only=True, slots=True)
class Look:
    """Look of a rendered scene; see the fields. JSON in records."""

    renderer: str = CLASSIC
    """One of `RENDERERS`. What the others say holds for both; where it stays at its default, each
    renderer has lights of its own."""
    seed: int = 0
    """Seeds textures, clutter, colour variation and noise: the same seed, the same images."""
    parts: Mapping[str, Material] = field(default_factory=dict)
    """Materials of parts of the workcell, by `PARTS`. That of the walls is the background."""
    objects: Mapping[str, Material] = field(default_factory=dict)
    """Materials of objects, by the name of the prop or of a part of it, as in `chest/lid`. A colour
    takes the place of the object's main colour; trim of another colour stays. With "*" for all
    objects that are not named, which must have no colour. Mind the instruction: an object that it
    calls white should stay white."""
    colour_variation: float = 0.0
    """How far the colours of objects are shifted at random, 0 to 1: within what is still called by
    the same name. Objects of one colour stay objects of one colour."""
    lights: tuple[Light, ...] | None = None
    """The lights; None keeps those of the workcell."""
    ambient: RGB | None = None
    """Light that comes from everywhere; None keeps that of the workcell."""
    clutter: int = 0
    """Pieces of furniture along the walls, visible and out of reach."""
    cameras: Mapping[str, CameraOffset] = field(default_factory=dict)
    """Offsets by the name of the camera."""
    exposure: float = 0.0
    """Exposure of the images in stops: +1 doubles the light."""
    blur: float = 0.0
    """Standard deviation of a Gaussian blur as a share of the image's height."""
    noise: float = 0.0
    """Standard deviation of Gaussian noise as a share of full brightness. Its sample is a function
    of seed, camera and simulation state."""

    def __post_init__(self) -> None:
        check_known("renderer", self.renderer, RENDERERS)
        for name in self.parts:
            check_known("part of the workcell", name, PARTS)
        for name in self.cameras:
            check_known("camera", name, (*POLICY_CAMERAS, OVERVIEW))
        every = self.objects.get(EVERY_OBJECT, Material())
        if every.colour is not None or every.image is not None:
            raise OptionError(
                "One colour or image for all objects would hide what an instruction names; a "
                "texture keeps their colours."
            )
        _check_colour("ambient", self.ambient)
        _check_range("colour_variation", self.colour_variation, 0.0, 1.0)
        _check_range("exposure", self.exposure, -4.0, 4.0)
        _check_range("blur", self.blur, 0.0, 0.05)
        _check_range("noise", self.noise, 0.0, 0.5)
        if not isinstance(self.seed, int) or self.seed < 0:
            raise OptionError(
                f"The seed of a look is a whole number from 0 on, got {self.seed}."
            )
        if not 0 <= self.clutter <= MAX_CLUTTER:
            raise OptionError(
                f"A look has 0 to {MAX_CLUTTER} pieces, got {self.clutter}."
            )
        lights = self.lights or ()
        shadows = sum(light.shadow for light in lights)
        if len(lights) > MAX_LIGHTS or shadows > 1:
            raise OptionError(
                f"A look has at most {MAX_LIGHTS} lights, and one of them casts shadows (the "
                f"cameras share one shadow map); got {len(lights)}, {shadows} with shadows."
            )

    def to_json(self) -> dict[str, Any]:
        """Return plain data, without values at their default."""
        plain, default = msgspec.to_builtins(self), asdict(Look())
        return {name: value for name, value in plain.items() if value != default[name]}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Read the result of `to_json` or `dataclasses.asdict`."""
        return decode(dict(data), cls, "look")


def _is_vector(numbers: tuple[float, ...]) -> bool:
    """Whether these are three finite numbers."""
    return len(numbers) == 3 and all(map(math.isfinite, numbers))  # noqa: PLR2004 - in space


def _check_colour(name: str, colour: RGB | None) -> None:
    if colour is None or (
        _is_vector(colour) and all(0.0 <= part <= 1.0 for part in colour)
    ):
        return
    raise OptionError(f"{name} is red, green and blue from 0 to 1, got {colour}.")


def _check_range(
    name: str,
    value: float,
    low: float,
    high: float,
) -> None:
    if not low <= value <= high:
        raise OptionError(f"{name} is {low:g} to {high:g}, got {value!r}.")
