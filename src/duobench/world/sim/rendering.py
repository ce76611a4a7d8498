"""Images of a simulation, rendered offscreen.

The first image starts a process that renders; OpenGL is never loaded into this one. An image shows
the whole field of view of its camera at every size, so a square image is the native one
squeezed to a square.
"""

import weakref
from collections.abc import Iterable
from typing import Any, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.backend import Image
from duobench.core.errors import RenderingError, check_known
from duobench.world.looks.look import Look
from duobench.world.robot.cameras import check_image_size
from duobench.world.sim.appearance import Appearance
from duobench.world.sim.opengl import RenderingInfo, choose
from duobench.world.sim.rendering_process import Pictured, RenderingProcess, current

MAX_SAMPLES = 64
"""Most images that are averaged into one."""


def describe() -> RenderingInfo:
    """Say what renders images for this process; starts what renders, to find out."""
    return current(choose()).info


class Renderer:
    """Renders images of one size from the cameras of one model.

    May be used from any thread, one at a time. A process may hold several, whose images are
    rendered one after the other, by the same child process.

    Args:
        model: The compiled model; `Simulation.model`.
        height: Height of the images in pixels, at most 720.
        width: Width of the images in pixels, at most 1280.
        samples: Images that are averaged into one, each with the camera moved by a part of
            a pixel and the light by a part of its size. One is what policies see; with 4 or
            more, edges are smooth and shadows soft, for people.
        look: How it looks; `Look()` is the scene as it was composed.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        height: int,
        width: int,
        samples: int = 1,
        look: Look | None = None,
    ) -> None:
        check_image_size(height, width)
        if not 1 <= samples <= MAX_SAMPLES:
            raise RenderingError(f"Samples must be 1 to {MAX_SAMPLES}, got {samples}.")
        self._model = model
        self._cameras = {
            model.camera(number).name: number for number in range(model.ncam)
        }
        self._shape = height, width, samples
        self._pictured = Pictured(model)
        self._closed = False
        self._process: RenderingProcess | None = None
        self._key = 0
        self._shown: list[Any] = [None, None]
        """Last told to the process: what the model shows, and the look."""
        self._free: weakref.finalize[Any, Any] | None = None
        self._look, self._appearance = Look(), None
        self.set_look(look or Look())

    def set_look(self, look: Look) -> None:
        """Render in another look from the next image on; the model stays as it is."""
        if look != self._look:
            self._appearance = None if look == Look() else Appearance(self._model, look)
            self._look = look

    def render(self, data: mujoco.MjData, camera: str) -> Image:
        """Render one image, a new array (height, width, 3), from one camera; see `render_all`."""
        return self.render_all(data, (camera,))[camera]

    def render_all(
        self, data: mujoco.MjData, cameras: Iterable[str]
    ) -> dict[str, Image]:
        """Render one image of the same state from each of several cameras of the model.

        Faster than one call for each: the shadows are computed once. The images of the state, whose
        kinematics are up to date, are new arrays (height, width, 3), red green blue, top row first.
        """
        numbers = {name: self._number(name) for name in cameras}
        return self._ask("render", data, numbers)

    def segment(self, data: mujoco.MjData, camera: str) -> NDArray[np.int32]:
        """Ids of the geoms (height, width) that the pixels show, -1 where there is nothing.

        A look's furniture is no geom, and is not in the way.
        """
        number = self._number(camera)
        return self._ask("segment", data, number)

    @property
    def info(self) -> RenderingInfo:
        """Renderer of the images."""
        return self._opened().info

    def close(self) -> None:
        """Free the renderer; closing twice is harmless."""
        self._closed = True
        self._process = None
        if self._free is not None:
            self._free()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _number(self, camera: str) -> int:
        check_known("camera", camera, self._cameras)
        return self._cameras[camera]

    def _ask(
        self,
        what: str,
        data: mujoco.MjData,
        cameras: Any,
    ) -> Any:
        """Have the process do something with a state, of the model and in the look as they are."""
        process = self._opened()
        model = self._pictured.of_model()
        if model != self._shown[0]:
            process.ask("set_model", self._key, *model)
            self._shown[0] = model
        if self._appearance is not self._shown[1]:
            process.ask("set_appearance", self._key, self._appearance)
            self._shown[1] = self._appearance
        return process.ask(what, self._key, *self._pictured.of_data(data), cameras)

    def _opened(self) -> RenderingProcess:
        """The process of this renderer, which is made there if it is not there yet, or no more."""
        if self._closed:
            raise RenderingError("This renderer was closed; make a new one.")
        if self._process is not None and self._process is current():
            return self._process
        process = current(choose())
        packed = np.empty(mujoco.mj_sizeModel(self._model), dtype=np.uint8)
        mujoco.mj_saveModel(self._model, None, packed)
        self._shown = [self._pictured.of_model(), None]
        self._key = process.new_number()
        process.ask("open", self._key, packed.tobytes(), *self._shape)
        if self._free is not None:
            self._free.detach()
        self._free = weakref.finalize(self, process.free, self._key)
        self._free.atexit = False
        self._process = process
        return process
