"""Images of recorded states, with the numbers of their objects, and of recorded videos.

Those of videos are as the simulation's cameras would have seen the same.
"""

from collections.abc import (
    Callable,
    Iterator,
    Mapping,
    Sequence,
)
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.error import FFmpegError
from numpy.typing import NDArray

from duobench.core.backend import (
    RGB,
    CameraGeometry,
    Image,
)
from duobench.core.errors import DataError, DuoBenchError, OptionError
from duobench.core.types import as_size
from duobench.core.video import in_rgb
from duobench.data.recording import Recording
from duobench.data.schema import video_path
from duobench.envs.camera_options import camera_options, wanted_images
from duobench.envs.config import IMAGE_SIZE
from duobench.tasks import catalog
from duobench.tasks.object_state import ObjectState
from duobench.tasks.task import Task
from duobench.world.looks.catalog import DEFAULT, as_look
from duobench.world.looks.look import Look
from duobench.world.robot.cameras import OVERVIEW, POLICY_CAMERAS, Camera
from duobench.world.robot.frames import Robot
from duobench.world.sim.backend import SimBackend
from duobench.world.sim.layout import Layout
from duobench.world.sim.simulation import Simulation


class ImageSource:
    """Shows recorded states of one task: as images, and as the numbers of its objects.

    Args:
        task: The task, its id, or its import path.
        cameras: Which cameras to render: names, or a `Camera` of one's own.
        size: Height and width of the images in pixels, or one number for a square; a camera with a
            size has its own.
        look: Look of the images, which may differ from that of the recording.
        depth: Cameras whose depth is rendered too, by name, or True for all.
        segmentation: The same of what each pixel shows.

    Raises:
        UnknownNameError: There is no such task, camera or look.
        OptionError: The size is invalid.
    """

    def __init__(
        self,
        task: str | Task,
        *,
        cameras: str | Camera | Sequence[str | Camera] = POLICY_CAMERAS,
        size: int | tuple[int, int] = IMAGE_SIZE,
        look: str | Look = DEFAULT,
        depth: bool | str | Sequence[str] = (),
        segmentation: bool | str | Sequence[str] = (),
    ) -> None:
        definition = catalog.get(task)
        self.definition = definition
        """The task."""
        self.object_state: ObjectState = definition.object_state
        self.simulation = Simulation(definition.props, definition.overview)
        """The physics, in the state that was shown last."""
        self._backend = SimBackend(self.simulation)
        self.set_look(look)
        pixels = as_size(size)
        if pixels is None:
            raise OptionError(
                f"size is (height, width) in pixels, or one number for a square; got {size!r}."
            )
        given = {"cameras": cameras, "depth": depth, "segmentation": segmentation}
        seen = {} if isinstance(cameras, Mapping) else camera_options(given)
        for name, value in given.items():
            if not isinstance(seen.get(name), tuple):
                raise OptionError(
                    f"{name} is a name, or a list of names; got {value!r}."
                )
        known = (*POLICY_CAMERAS, OVERVIEW)
        self._wanted = wanted_images(**seen, size=pixels, sizes={}, known=known)
        self._layout: dict[str, Any] | None = None

    def set_look(self, look: str | Look) -> None:
        """Change the look of later images; the model is not compiled again."""
        self._backend.set_look(as_look(look))

    def take(self, robot: Robot) -> None:
        """Show a robot from now on; another one than before is compiled first."""
        if robot == self.simulation.robot:
            return
        task, look = self.definition, self._backend.look
        self._backend.close()
        self.simulation = Simulation(task.props, task.overview, robot)
        self._backend = SimBackend(self.simulation)
        self._backend.set_look(look)
        self._layout = None

    def show(self, recording: Recording, row: int) -> None:
        """Bring the simulation into the state of a row of a recording.

        Raises:
            DataError: There is no such row, or the state does not fit the task.
        """
        if not 0 <= row < len(recording.state):
            raise DataError(
                f"The episode has states 0 to {len(recording.state) - 1}, not {row}."
            )
        self.take(recording.info.robot)
        try:
            if recording.info.layout != self._layout:
                self._layout = None
                self.simulation.apply(Layout.from_json(recording.info.layout))
                self._layout = recording.info.layout
            self.simulation.set_state(recording.state[row])
        except DuoBenchError as error:
            raise DataError(
                f"Row {row} of an episode of {recording.info.task} cannot be shown: {error}"
            ) from error

    def images(self, recording: Recording, row: int) -> dict[str, Image]:
        """Images (height, width, 3) of a row by camera, as the environment gave them.

        Raises:
            DataError: The state does not fit the task.
            RenderingError: Nothing can be rendered.
        """
        return self.images_by_kind(recording, row).get(RGB, {})

    def images_by_kind(
        self, recording: Recording, row: int
    ) -> dict[str, dict[str, Any]]:
        """Images of a row by kind ("rgb", "depth", "segmentation") and camera; see `images`."""
        self.show(recording, row)
        return self._backend.images_by_kind(self._wanted)

    def geometry(self, recording: Recording, row: int) -> dict[str, CameraGeometry]:
        """Lens and place of each camera at a row, by name, where the look has them."""
        self.show(recording, row)
        sizes = {
            camera: size
            for each in self._wanted.values()
            for camera, size in each.items()
        }
        return self._backend.camera_geometry(sizes)

    def objects(self, recording: Recording, row: int) -> NDArray[np.float32]:
        """The numbers (n,) of `object_state` at a row, as the environment gave them on request.

        Raises:
            DataError: The state does not fit the task.
        """
        self.show(recording, row)
        return self.object_state.read(self.simulation)

    def close(self) -> None:
        """Free the renderer."""
        self._backend.close()


View = Callable[[Image, tuple[int, int]], Image]
"""Makes an image of some height and width from one as a camera gave it."""
ViewOf = Callable[[str, Mapping[str, Any]], View]
"""Gives the view of a camera, by its name and by what its rig says about it."""


def resized(image: Image, size: tuple[int, int]) -> Image:
    """An image (height, width, 3) of another size: each pixel is the mean of those it covers."""
    if image.shape[:2] == size:
        return image
    from PIL import Image as Pillow

    height, width = size
    return np.asarray(
        Pillow.fromarray(image).resize((width, height), Pillow.Resampling.BOX)
    )


def plain_view(camera: str, about: Mapping[str, Any]) -> View:
    """The view of a camera that has the simulation's lens, not one of its own: resized."""
    if about.get("calibration") is not None:
        raise DataError(
            f"The camera {camera} has a lens of its own; its images need the view of the rig."
        )
    return resized


class VideoFrames:
    """Reads frames of one video, or raises a `DataError`; fast where their places ascend."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._open()

    def _open(self) -> None:
        try:
            self._container = av.open(self._path)
        except (FFmpegError, OSError) as error:
            raise DataError(f"{self._path} cannot be read: {error}.") from error
        self._frames: Iterator[av.VideoFrame] = self._container.decode(video=0)
        self._place = -1
        self._image: av.VideoFrame | None = None

    def read(self, place: int) -> Image:
        """The frame (height, width, 3) at a place from 0 on."""
        if place < self._place:
            self.close()
            self._open()
        try:
            while self._place < place:
                self._image = next(self._frames)
                self._place += 1
        except (StopIteration, FFmpegError, OSError) as error:
            raise DataError(
                f"{self._path} has no frame {place} that can be read; it has {self._place + 1}."
            ) from error
        if self._image is None:
            raise DataError(
                f"{self._path}: places of frames begin with 0, got {place}."
            )
        return in_rgb(self._image)

    def close(self) -> None:
        """Close the video; closing twice is harmless."""
        self._container.close()


class RecordedImages:
    """Reads the images that belong to rows of an episode, of some height and width in pixels.

    It is fast where rows ascend, and raises a `DataError` where a camera has no video, or one that
    cannot be read.
    """

    def __init__(
        self,
        recording: Recording,
        path: Path,
        cameras: Sequence[str],
        size: tuple[int, int],
        view_of: ViewOf = plain_view,
    ) -> None:
        info = recording.info
        check_cameras(recording, path, cameras)
        self._size = size
        self._places = {
            name: recording.frame[:, list(info.videos).index(name)] for name in cameras
        }
        self._views = {
            name: view_of(name, info.cameras.get(name, {})) for name in cameras
        }
        self._videos = {name: VideoFrames(video_path(path, name)) for name in cameras}

    def images(self, row: int) -> dict[str, Image]:
        """The images (height, width, 3) of a row, by camera."""
        return {
            name: self._views[name](
                video.read(int(self._places[name][row])), self._size
            )
            for name, video in self._videos.items()
        }

    def close(self) -> None:
        """Close the videos."""
        for video in self._videos.values():
            video.close()


def check_cameras(
    recording: Recording,
    path: Path,
    cameras: Sequence[str],
) -> None:
    """Reject an episode that has no image of a camera."""
    videos = recording.info.videos
    for name in cameras:
        if name not in videos:
            has = ", ".join(videos) or "none"
            raise DataError(f"{path} has no video of the camera {name}; it has {has}.")
        if not video_path(path, name).exists():
            raise DataError(f"{video_path(path, name)} is missing.")
        if recording.frame[:, list(videos).index(name)].min() < 0:
            raise DataError(
                f"{path}: its first rows have no image of the camera {name}."
            )
