"""Images of a simulation, rendered offscreen.

The first image starts a process that renders; OpenGL is never loaded into this one. Looks of the
studio have another process, whose renderer gives colours only. An image shows the whole field of
view of its camera at every size, so a square image is the native one squeezed to a square.
"""

import math
import weakref
from collections.abc import Iterable
from typing import Any, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.backend import (
    KINDS,
    RGB,
    Image,
    Wanted,
)
from duobench.core.errors import RenderingError, check_known
from duobench.core.spatial import SE3
from duobench.world.looks.look import CLASSIC, STUDIO, Look
from duobench.world.robot.cameras import Camera, check_image_size
from duobench.world.scene.naming import flange_name
from duobench.world.sim.appearance import Appearance
from duobench.world.sim.offscreen import FREE, CameraRequest
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

    def render(self, data: mujoco.MjData, camera: str | Camera) -> Image:
        """Render one image, a new array (height, width, 3), from one camera; see `render_all`."""
        (image,) = self.render_all(data, (camera,)).values()
        return image

    def render_all(
        self, data: mujoco.MjData, cameras: Iterable[str | Camera]
    ) -> dict[str, Image]:
        """Render one image of the same state from each of several cameras.

        They are the model's, by name, or cameras of one's own. Faster than one call for each: the
        shadows are computed once. The images of the state, whose kinematics are up to date, are new
        arrays (height, width, 3), red green blue, top row first.
        """
        size = self._shape[:2]
        images = self.render_kinds(data, {RGB: dict.fromkeys(cameras, size)})
        return images.get(RGB, {})

    def render_kinds(
        self, data: mujoco.MjData, wanted: Wanted
    ) -> dict[str, dict[str, Any]]:
        """Render images of several kinds and sizes of one state, by kind and name of the camera.

        Sizes are at most that of the renderer. Depth is float32 (height, width), metres along the
        optical axis, 0 where nothing is or what is there lies beyond the far plane; a segmentation
        int32, numbers of geoms, or `FURNITURE` or `NOTHING`. Samples and what a look does to images
        leave both alone: each pixel is what its middle shows.
        """
        asked: dict[tuple[Any, tuple[int, int], str], list[str]] = {}
        for kind in KINDS:
            renderer = self._look.renderer if kind == RGB else CLASSIC
            for camera, size in wanted.get(kind, {}).items():
                asked.setdefault((camera, size, renderer), []).append(kind)
        requests: dict[str, list[CameraRequest]] = {}
        for (camera, size, renderer), kinds in asked.items():
            request = self._request(data, camera, size, tuple(kinds))
            requests.setdefault(renderer, []).append(request)
        found: dict[str, dict[str, Any]] = {
            kind: {} for kind in KINDS if wanted.get(kind)
        }
        for renderer, some in requests.items():
            for name, images in self._ask("render", data, some, renderer).items():
                for kind, image in images.items():
                    found[kind][name] = image
        return found

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

    def _request(
        self,
        data: mujoco.MjData,
        camera: str | Camera,
        size: tuple[int, int],
        kinds: tuple[str, ...],
    ) -> CameraRequest:
        """Images of a camera, with the place of one that is not in the model."""
        check_image_size(*size)
        if size[0] > self._shape[0] or size[1] > self._shape[1]:
            raise RenderingError(
                f"This renderer has images of at most {self._shape[1]}x{self._shape[0]}, got "
                f"{size[1]}x{size[0]}; make a larger one."
            )
        if not isinstance(camera, Camera):
            return CameraRequest(camera, self._number(camera), kinds, size)
        mount = SE3()
        if camera.arm is not None:
            site = data.site(flange_name(camera.arm))
            mount = SE3(site.xmat.reshape(3, 3), site.xpos)
        pose, fovy = mount @ camera.pose, math.radians(camera.fovy_deg)
        return CameraRequest(camera.name, FREE, kinds, size, pose, fovy)

    def _number(self, camera: str) -> int:
        check_known("camera", camera, self._cameras)
        return self._cameras[camera]

    def _ask(
        self,
        what: str,
        data: mujoco.MjData,
        cameras: Any,
        renderer: str = CLASSIC,
    ) -> Any:
        """Have a process do something with a state, of the model and in the look as they are."""
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
