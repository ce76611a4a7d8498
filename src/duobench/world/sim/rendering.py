"""Images of a simulation, rendered offscreen.

The first image starts a process that renders; OpenGL is never loaded into this one. Looks of the
studio have another process, whose renderer gives colours only. An image shows the whole field of
view of its camera at every size, so a square image is the native one squeezed to a square.
"""

import weakref
from collections.abc import Iterable
from typing import Any, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.backend import Image
from duobench.core.errors import RenderingError, check_known
from duobench.world.looks.look import CLASSIC, STUDIO, Look
from duobench.world.robot.cameras import check_image_size
from duobench.world.sim.appearance import Appearance
from duobench.world.sim.opengl import VULKAN, RenderingInfo, choose
from duobench.world.sim.rendering_process import Pictured, RenderingProcess, current

MAX_SAMPLES = 64
"""Most images that are averaged into one."""


def describe(renderer: str = CLASSIC) -> RenderingInfo:
    """Say what renders a look's images for this process; starts what renders, to find out."""
    return current(VULKAN if renderer == STUDIO else choose()).info


class _Counterpart:
    """Counterpart of a renderer in a process that renders."""

    def __init__(self) -> None:
        self.process: RenderingProcess | None = None
        self.key = 0
        self.shown: list[Any] = [None, None]
        """Last told to the process: what the model shows, and the look."""
        self.free: weakref.finalize[Any, Any] | None = None


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
        self._counterparts = {CLASSIC: _Counterpart(), STUDIO: _Counterpart()}
        """By the name of the renderer."""
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
        return self._opened(self._look.renderer)[0].info

    def close(self) -> None:
        """Free the renderer; closing twice is harmless."""
        self._closed = True
        for served in self._counterparts.values():
            served.process = None
            if served.free is not None:
                served.free()

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
        renderer = self._look.renderer if what == "render" else CLASSIC
        process, served = self._opened(renderer)
        model = self._pictured.of_model()
        if model != served.shown[0]:
            process.ask("set_model", served.key, *model)
            served.shown[0] = model
        if self._appearance is not served.shown[1]:
            process.ask("set_appearance", served.key, self._appearance)
            served.shown[1] = self._appearance
        return process.ask(what, served.key, *self._pictured.of_data(data), cameras)

    def _opened(self, renderer: str) -> tuple[RenderingProcess, _Counterpart]:
        """The process of a renderer, and this one's counterpart there, made if it is missing."""
        if self._closed:
            raise RenderingError("This renderer was closed; make a new one.")
        served = self._counterparts[renderer]
        vulkan = VULKAN if renderer == STUDIO else None
        if served.process is not None and served.process is current(vulkan):
            return served.process, served
        process = current(vulkan or choose())
        packed = np.empty(mujoco.mj_sizeModel(self._model), dtype=np.uint8)
        mujoco.mj_saveModel(self._model, None, packed)
        served.shown = [self._pictured.of_model(), None]
        served.key = process.new_number()
        process.ask("open", served.key, packed.tobytes(), *self._shape)
        if served.free is not None:
            served.free.detach()
        served.free = weakref.finalize(self, process.free, served.key)
        served.free.atexit = False
        served.process = process
        return process, served
