"""Images of a simulation, rendered offscreen.

Importing this module touches no OpenGL, and neither does making a `Renderer`: the first image
does. An image shows the whole field of view of its camera whatever its size, so a square image
is the native one squeezed to a square.
"""

import os
import weakref
from collections.abc import Callable, Iterable
from typing import Any, Self, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.backend import Image
from duobench.errors import RenderingError, check_known
from duobench.looks.look import Look
from duobench.robot.cameras import check_image_size
from duobench.sim.appearance import Appearance
from duobench.sim.offscreen import OffscreenRenderer
from duobench.sim.opengl import RenderingInfo, RenderThread, choose, load_triton

T = TypeVar("T")

MAX_SAMPLES = 64
"""Most images that are averaged into one."""


def describe() -> RenderingInfo:
    """Say what renders images in this process; makes an OpenGL context to find out."""
    with Renderer(mujoco.MjSpec().compile(), height=1, width=1) as renderer:
        return renderer.info


class Renderer:
    """Renders images of one size from the cameras of one model.

    May be used from any thread, one at a time. A process may hold several; a renderer cannot be
    taken into another process.

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
        self._cameras = {model.camera(number).name: number for number in range(model.ncam)}
        self._shape = height, width, samples
        self._pid = os.getpid()
        self._closed = False
        self._open: tuple[RenderThread, OffscreenRenderer] | None = None
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

    def render_all(self, data: mujoco.MjData, cameras: Iterable[str]) -> dict[str, Image]:
        """Render one image of the same state from each of several cameras of the model.

        Faster than one call for each: the shadows are computed once. The images of the state, whose
        kinematics are up to date, are new arrays (height, width, 3), red green blue, top row first.
        """
        numbers = {name: self._number(name) for name in cameras}
        return self._run(lambda offscreen: offscreen.render(data, numbers))

    def segment(self, data: mujoco.MjData, camera: str) -> NDArray[np.int32]:
        """Ids of the geoms (height, width) that the pixels show, -1 where there is nothing.

        A look's furniture is no geom, and is not in the way.
        """
        number = self._number(camera)
        return self._run(lambda offscreen: offscreen.segment(data, number))

    @property
    def info(self) -> RenderingInfo:
        """What renders the images."""
        return self._run(lambda offscreen: offscreen.info)

    def close(self) -> None:
        """Free the renderer; closing twice is harmless."""
        self._closed = True
        self._open = None
        if self._free is not None:
            self._free()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _number(self, camera: str) -> int:
        check_known("camera", camera, self._cameras)
        return self._cameras[camera]

    def _run(self, job: Callable[[OffscreenRenderer], T]) -> T:
        """Run a job with the offscreen, on its thread."""
        if self._closed:
            raise RenderingError("This renderer was closed; make a new one.")
        if os.getpid() != self._pid:
            raise RenderingError(
                "This renderer belongs to the process that made it; make a new one in this "
                "process, and start processes with the method 'spawn'."
            )
        thread, offscreen = self._open = self._open or self._start()
        appearance = self._appearance

        def in_look() -> T:
            offscreen.set_appearance(appearance)
            return job(offscreen)

        return thread.call(in_look)

    def _start(self) -> tuple[RenderThread, OffscreenRenderer]:
        model, shape, backend = self._model, self._shape, choose()
        load_triton()
        thread = RenderThread()
        try:
            offscreen = thread.call(lambda: OffscreenRenderer(model, *shape, backend))
        except BaseException:
            thread.finish()
            raise
        # The thread ends with the renderer; at exit that is not needed.
        self._free = weakref.finalize(self, thread.finish, offscreen.free)
        self._free.atexit = False
        return thread, offscreen
