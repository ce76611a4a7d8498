"""Options about cameras, as environments and policies have them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from duobench.core.backend import (
    DEPTH,
    RGB,
    SEGMENTATION,
    AnyCamera,
    Sizes,
)
from duobench.core.errors import OptionError, check_known
from duobench.core.types import as_flag, as_several, as_size
from duobench.world.robot.cameras import POLICY_CAMERAS, Camera, camera_of

CAMERA_OPTIONS = ("cameras", "image_sizes", DEPTH, SEGMENTATION)


def camera_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options about cameras, where they are among some, in the form of their fields if possible."""
    forms = _cameras, _sizes, _names, _names
    values = {
        name: form(options[name])
        for name, form in zip(CAMERA_OPTIONS, forms, strict=True)
        if name in options
    }
    if isinstance(values.get("cameras"), Mapping):
        values["cameras"], by_name = _with_sizes(values["cameras"])
        others = values.get("image_sizes", {})
        if isinstance(others, Mapping):  # anything else is rejected as it is
            values["image_sizes"] = {**others, **by_name}
    for name in (DEPTH, SEGMENTATION):
        if as_flag(values.get(name)) is True:
            cameras = as_several(values.get("cameras", POLICY_CAMERAS)) or ()
            values[name] = tuple(map(name_of, cameras)) or POLICY_CAMERAS
    return values


def name_of(camera: Any) -> Any:
    """Name of a camera of one's own, or of the robot's, which is given by it."""
    return camera.name if isinstance(camera, Camera) else camera


def wanted_images(
    cameras: Sequence[str | Camera],
    depth: Sequence[str],
    segmentation: Sequence[str],
    size: tuple[int, int],
    sizes: Mapping[str, tuple[int, int]],
    known: Sequence[str] = POLICY_CAMERAS,
) -> dict[str, Sizes]:
    """Images of an observation by their kind, with their sizes; names are known ones.

    Raises:
        UnknownNameError: There is no such camera.
        OptionError: Two cameras have one name.
    """
    own = {camera.name: camera for camera in cameras if isinstance(camera, Camera)}
    if len(own) < sum(isinstance(camera, Camera) for camera in cameras):
        names = [name_of(camera) for camera in cameras]
        twice = next(name for name in names if names.count(name) > 1)
        raise OptionError(
            f"Two cameras are called {twice!r}; each has a name of its own, such as "
            f"'{twice}_2'."
        )
    known = (*known, *own)
    for name in sizes:
        check_known("camera", name, known)
    wanted: dict[str, Sizes] = {}
    for kind, given in ((RGB, cameras), (DEPTH, depth), (SEGMENTATION, segmentation)):
        by_camera: dict[str | AnyCamera, tuple[int, int]] = {}
        for name in map(name_of, given):
            check_known("camera", name, known)
            camera = own.get(name)
            usual = size if camera is None or camera.size is None else camera.size
            by_camera[camera or name] = sizes.get(name, usual)
        if by_camera:
            wanted[kind] = by_camera
    return wanted


def _cameras(value: Any) -> Any:
    if isinstance(value, bool):
        return POLICY_CAMERAS if value else ()
    is_one = isinstance(value, Mapping) and "name" in value
    several = (value,) if is_one or isinstance(value, Camera) else as_several(value)
    if several is None:
        return value
    return tuple(
        camera_of(each) if isinstance(each, Mapping) else each for each in several
    )


def _names(value: Any) -> Any:
    if as_flag(value) is False:
        return ()
    if isinstance(value, Camera):  # in a tuple, it is rejected by what it is
        return (value,)
    return value if (names := as_several(value)) is None else names


def _sizes(value: Any) -> Any:
    if not isinstance(value, Mapping):
        return value
    return {name: as_size(size) or size for name, size in value.items()}


def _with_sizes(
    given: Mapping[Any, Any],
) -> tuple[tuple[str | Camera, ...], dict[str, Any]]:
    """Cameras, and the sizes of those of the robot, of sizes by camera."""
    cameras = tuple(
        replace(camera, size=size)
        if isinstance(camera, Camera) and size is not None
        else camera
        for camera, size in given.items()
    )
    return cameras, {
        name: as_size(size) or size
        for name, size in given.items()
        if size is not None and not isinstance(name, Camera)
    }
