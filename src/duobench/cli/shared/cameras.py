"""Cameras on the command line: names, and cameras of one's own as JSON or by their import path."""

from typing import Any

from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
)

from duobench.cli.shared.advice import AdvisedError
from duobench.core.references import load
from duobench.core.settings import parse
from duobench.world.robot.cameras import Camera, camera_of

REGISTRY = ConstructorRegistry()
"""How the command line reads cameras, and names that may be left out for all."""


def read_camera(text: str) -> str | Camera:
    """A camera of one's own in JSON, or of a path `module:NAME`; anything else is a name."""
    if text.startswith("{"):
        try:
            return camera_of(parse(text))
        except ValueError as error:
            raise AdvisedError(f"{text} is no camera: {error}") from error
    if ":" in text:
        return load(text, "camera", lambda value: isinstance(value, Camera))
    return text


@REGISTRY.primitive_rule
def _rule(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    reads = {
        tuple[str | Camera, ...]: lambda words: tuple(map(read_camera, words)),
        bool | tuple[str, ...]: lambda words: tuple(words) or True,
    }
    if info.type not in reads:
        return None
    return PrimitiveConstructorSpec(
        nargs="*",
        metavar="[CAMERA [CAMERA ...]]",
        instance_from_str=reads[info.type],
        is_instance=lambda value: isinstance(value, bool | tuple),
        str_from_instance=lambda value: list(map(str, value or ())),
    )
