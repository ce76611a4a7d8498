"""Folders of images, with the joints of an arm beside them, from which cameras are calibrated.

A folder can be measured again at any time, without a robot: `views.json` says which image was taken
at which joints. A folder that holds images only is enough for lenses and for the head camera.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image as Pictures

from duobench.core import files
from duobench.core.backend import Image
from duobench.core.errors import CalibrationError, FileError
from duobench.core.types import Array
from duobench.real.calibration.places import BoardView

VIEWS_SCHEMA = 1
"""Version of the file; raised when a field changes its meaning."""
VIEWS_FILE = "views.json"
_ENDINGS = (".png", ".jpg", ".jpeg")


@dataclass(frozen=True, kw_only=True, slots=True)
class ViewEntry:
    """One image."""

    image: str
    joints: tuple[float, ...] | None = None
    """Joint positions of the arm in radians, if it moves the camera."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ViewList:
    """List of the views in a folder."""

    camera: str
    views: tuple[ViewEntry, ...] = ()


class ViewFolder:
    """A folder of images of one camera; what was added is on the disk at once.

    Raises:
        CalibrationError: It holds images of another camera.
        FileError: Its list cannot be read.
    """

    def __init__(self, path: Path, camera: str) -> None:
        self.path = path
        self._list = ViewList(camera=camera)
        file = path / VIEWS_FILE
        if file.exists():
            self._list = files.read(file, ViewList, VIEWS_SCHEMA)
        elif path.is_dir():
            names = sorted(
                each.name for each in path.iterdir() if each.suffix.lower() in _ENDINGS
            )
            entries = tuple(ViewEntry(image=name) for name in names)
            self._list = ViewList(camera=camera, views=entries)
        if self._list.camera != camera:
            raise CalibrationError(
                f"{path} holds images of {self._list.camera}, not of {camera}; take another folder."
            )

    def __len__(self) -> int:
        return len(self._list.views)

    def add(self, image: Image, joints: Array | None = None) -> None:
        """Add an image (height, width, 3), and joints (7,) in radians of the arm that holds it.

        Raises:
            OutputError: It cannot be written.
        """
        name = f"{len(self):03d}.png"
        files.make_folder(self.path)
        with files.replacing(self.path / name) as temporary:
            Pictures.fromarray(image).save(temporary, format="PNG", compress_level=1)
        measured = None if joints is None else tuple(float(each) for each in joints)
        entry = ViewEntry(image=name, joints=measured)
        self._list = replace(self._list, views=(*self._list.views, entry))
        files.write(self.path / VIEWS_FILE, files.encode(self._list, VIEWS_SCHEMA))

    def images(self) -> list[Image]:
        """All images.

        Raises:
            CalibrationError: No images, or images of several sizes.
            FileError: One cannot be read.
        """
        if not self._list.views:
            raise CalibrationError(f"{self.path} holds no images.")
        images = [_read(self.path / entry.image) for entry in self._list.views]
        if len({image.shape for image in images}) > 1:
            raise CalibrationError(f"The images of {self.path} are of several sizes.")
        return images

    def views(self) -> Sequence[BoardView]:
        """All images with the joints at which they were taken.

        Raises:
            CalibrationError: No images, or images without joints.
            FileError: An image cannot be read.
        """
        views = []
        for image, entry in zip(self.images(), self._list.views, strict=True):
            if entry.joints is None:
                raise CalibrationError(
                    f"{self.path / VIEWS_FILE} has to say the joints of the arm for every image."
                )
            views.append(BoardView(image=image, joints=np.array(entry.joints)))
        return views


def _read(path: Path) -> Image:
    try:
        with Pictures.open(path) as picture:
            return np.array(picture.convert("RGB"))
    except (OSError, ValueError) as error:
        raise FileError(f"{path} cannot be read as an image: {error}") from error
