"""Views of a rig's cameras, for exports of what they recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from duobench.data.views import View
from duobench.errors import DataError
from duobench.hardware.canonical import CanonicalView
from duobench.hardware.rig import CameraConfig


def view_of(camera: str, about: Mapping[str, Any]) -> View:
    """The view of a camera: its images as the simulation's camera would have taken them.

    It is the same that a policy has on the rig.

    Args:
        camera: Name of the camera.
        about: What the rig's file said about it when it was recorded.

    Raises:
        DataError: That is no camera of a rig.
    """
    try:
        config = msgspec.convert(dict(about), CameraConfig)
    except msgspec.ValidationError as error:
        raise DataError(f"What is said about the camera {camera} is invalid: {error}") from error
    return CanonicalView(camera, config.calibration, config.size).image
