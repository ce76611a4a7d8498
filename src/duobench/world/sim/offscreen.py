"""Offscreen rendering with MuJoCo, in the process that renders for a `Renderer`."""

import json
import math
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.backend import (
    DEPTH,
    RGB,
    SEGMENTATION,
    Image,
)
from duobench.core.errors import RenderingError
from duobench.core.spatial import SE3
from duobench.core.types import Array
from duobench.world.looks import effects
from duobench.world.looks.look import MAX_CLUTTER
from duobench.world.scene.surfaces import SHADOWLESS_GEOM_GROUP
from duobench.world.sim.appearance import Appearance, Texture
from duobench.world.sim.opengl import in_words, info_of, open_context
from duobench.world.sim.visibility import Visibility, frustum

VISIBLE_GROUPS = 3
"""Geom groups 0 to 2 are rendered; collision shapes are in group 3."""
LIGHT_RADIUS = 0.007
"""Tangent of half the angle under which the light appears, times the root of the number of samples:
the more samples, the wider a shadow's edge can be before it shows the single ones."""

_OPAQUE = 0.995
"""Opacity below which a geom is rendered as transparent [MuJoCo's renderer]."""
_DUMMY_SHADOW_MAP = 4
"""Side of the dummy shadow map: the smallest that leaves something inside its border."""
_EVERYTHING = mujoco.mjtCatBit.mjCAT_ALL.value
_DECOR = mujoco.mjtCatBit.mjCAT_DECOR.value
_NOTHING = mujoco.mjtGeom.mjGEOM_NONE.value
_DIRECTIONAL = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL.value
_EFFECTS = [
    mujoco.mjtRndFlag.mjRND_REFLECTION.value,
    mujoco.mjtRndFlag.mjRND_SKYBOX.value,
    mujoco.mjtRndFlag.mjRND_HAZE.value,
    mujoco.mjtRndFlag.mjRND_FOG.value,
]
_SHADOW = mujoco.mjtRndFlag.mjRND_SHADOW.value
FREE = -1
"""Number of a camera that is none of the model's."""
NOTHING, FURNITURE = -1, -2
"""In place of the number of a geom, of pixels that show none."""
_PROBE_MODEL = (
    '<mujoco><worldbody><camera pos="0 0 1"/><light pos="0 0 1"/><geom size="0.3"/></worldbody>'
    "</mujoco>"
)
_SEGMENTATION = [
    mujoco.mjtRndFlag.mjRND_SEGMENT.value,
    mujoco.mjtRndFlag.mjRND_IDCOLOR.value,
]


class CameraRequest(NamedTuple):
    """Images that are wanted of a camera, of the state that a call is about.

    Plain data, which goes to another process; every renderer answers the same requests.
    """

    name: str
    """Name of the camera."""
    number: int
    """Its number in the model, or `FREE`."""
    kinds: tuple[str, ...]
    """Some of `duobench.core.backend.KINDS`."""
    size: tuple[int, int]
    """Height and width in pixels, at most those of the renderer."""
    pose: SE3 | None = None
    """Pose in the world, with MuJoCo's axes, of a camera that is not in the model."""
    fovy: float = 0.0
    """Its vertical field of view in radians; its pixels are square."""


Images = dict[str, dict[str, Any]]
"""By name of the camera and kind: colours; metres along the optical axis, 0 beyond the far plane;
numbers of geoms, or `NOTHING` or `FURNITURE`."""


def answer(backend: str, seconds: float) -> None:
    """Render, say with what on the standard output, and end the process: the child of a probe."""
    model = mujoco.MjModel.from_xml_string(_PROBE_MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    try:
        renderer = OffscreenRenderer(model, 64, 64, 1, backend)
    except RenderingError as error:
        sys.exit(
            in_words(error.__cause__ or error)
        )  # the parent gives the advice, once
    deadline = time.monotonic() + seconds
    requests = [CameraRequest("", 0, (RGB,), (64, 64))]
    image = renderer.render(data, requests)[""][RGB]
    while time.monotonic() < deadline:
        image = renderer.render(data, requests)[""][RGB]
    if not image.any():
        sys.stderr.write("the image stayed black\n")
        os._exit(1)
    sys.stdout.write(json.dumps(asdict(renderer.info)) + "\n")
    sys.stdout.flush()
    # Drivers have crashed while a process that had already rendered was taken down.
    os._exit(0)


class OffscreenRenderer:
    """A context and all that was made with it; the context is current in every call."""

    def __init__(
        self, model: mujoco.MjModel, height: int, width: int, samples: int, backend: str
    ) -> None:
        self._model = model
        self._context = open_context(backend, height, width)
        try:
            self.info = info_of(backend)
            self._mujoco_context = mujoco.MjrContext(
                model, mujoco.mjtFontScale.mjFONTSCALE_50.value
            )
            mujoco.mjr_resizeOffscreen(width, height, self._mujoco_context)
        except Exception as error:
            self._context.free()
            raise RenderingError(
                f"OpenGL cannot render the scene: {in_words(error)}"
            ) from error
        self._shadows = self._mujoco_context.shadowFBO, self._mujoco_context.shadowSize
        # A dummy shadow map, for images that use the shadows of the one before.
        mujoco.mjr_addAux(
            0, _DUMMY_SHADOW_MAP, _DUMMY_SHADOW_MAP, 0, self._mujoco_context
        )
        mujoco.mjr_setBuffer(
            mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._mujoco_context
        )
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + MAX_CLUTTER)
        self._scene.flags[_EFFECTS] = 0
        self._geoms = self._scene.geoms
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = (
            np.arange(len(self._option.geomgroup)) < VISIBLE_GROUPS
        )
        self._option.sitegroup[:] = 0
        shadowless = model.geom_group == SHADOWLESS_GEOM_GROUP
        self._shadowless = set(np.flatnonzero(shadowless).tolist())
        self._objects = np.flatnonzero(
            ~shadowless & (model.geom_group < VISIBLE_GROUPS)
        )
        self._visibility = Visibility(model)
        # The far plane is 0 there, so that floats are dense where the scene is.
        self._mujoco_context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR.value
        self._view = mujoco.MjvCamera()
        self._size = height, width
        self._set_size(self._size)
        self._offsets = lens_offsets(samples)
        self._appearance: Appearance | None = None

    def make_current(self) -> None:
        """Let what is called next use this renderer's context."""
        self._context.make_current()

    def set_appearance(self, appearance: Appearance | None) -> None:
        """Render in a look from now on; None is the model's own."""
        if appearance is not self._appearance:
            if appearance is not None:
                upload(self._model, self._mujoco_context, appearance.textures)
            self._appearance = appearance

    def render(self, data: mujoco.MjData, requests: Sequence[CameraRequest]) -> Images:
        """Images of one state; shadows are rendered once, and the scene is made once."""
        images: Images = {}
        needs_scene = needs_shadows = True
        coloured = [request for request in requests if RGB in request.kinds]
        unseen = iter(list[list[int]]())
        for request in requests:
            self._set_size(request.size)
            found = images.setdefault(request.name, {})
            if RGB in request.kinds:
                if len(self._offsets) > 1:
                    image = self._average(data, request)
                    needs_scene = True
                else:
                    (self._update if needs_scene else self._turn_to)(data, request)
                    if needs_shadows:
                        unseen = iter(self._leave_out(data, coloured))
                        self._turn_to(data, request)
                    self._render(new_shadows=needs_shadows, without=next(unseen))
                    image = self._pixels[::-1].copy()
                    needs_scene = needs_shadows = False
                found[RGB] = self._with_effects(image, data, request)
            if DEPTH in request.kinds or SEGMENTATION in request.kinds:
                (self._update if needs_scene else self._turn_to)(data, request)
                needs_scene = False
                found |= self._measured(request.kinds)
        return images

    def segment(self, data: mujoco.MjData, camera: int) -> NDArray[np.int32]:
        """Numbers of geoms by pixel; furniture is not in the way."""
        request = CameraRequest("", camera, (SEGMENTATION,), self._size)
        self._set_size(self._size)
        self._update(data, request)
        return self._measured(request.kinds, furniture=False)[SEGMENTATION]

    def _with_effects(
        self, image: Image, data: mujoco.MjData, request: CameraRequest
    ) -> Image:
        """An image with what a look does to it after it was rendered."""
        if self._appearance is None:
            return image
        camera = request.name if request.number == FREE else request.number
        look = self._appearance.look
        return effects.apply(look, image, data.time, data.qpos, camera)

    def _measured(
        self, kinds: Sequence[str], *, furniture: bool = True
    ) -> dict[str, Any]:
        """Depth and numbers of geoms of the scene: one image without light, colours or effects."""
        geoms = self._geoms[: self._scene.ngeom]
        ids = np.full(len(geoms) + 1, NOTHING, dtype=np.int32)
        for place, geom in enumerate(geoms):
            is_furniture = geom.objid < 0
            geom.segid = NOTHING if is_furniture and not furniture else place
            ids[place + 1] = FURNITURE if is_furniture else geom.objid
        depth = np.empty(self._pixels.shape[:2], dtype=np.float32)
        shadow = self._scene.flags[_SHADOW]
        self._scene.flags[_SEGMENTATION] = 1
        self._scene.flags[_SHADOW] = 0
        try:
            mujoco.mjr_render(self._rectangle, self._scene, self._mujoco_context)
            mujoco.mjr_readPixels(
                self._pixels, depth, self._rectangle, self._mujoco_context
            )
        finally:
            self._scene.flags[_SEGMENTATION] = 0
            self._scene.flags[_SHADOW] = shadow
        found: dict[str, Any] = {}
        if DEPTH in kinds:
            found[DEPTH] = _metres(depth[::-1], self._scene.camera[0])
        if SEGMENTATION in kinds:
            found[SEGMENTATION] = ids[
                self._pixels[::-1].astype(np.int32) @ (1, 1 << 8, 1 << 16)
            ]
        return found

    def free(self) -> None:
        """Give back everything that was made with OpenGL."""
        self._restore_shadows()
        self._mujoco_context.free()
        self._context.free()

    def _set_size(self, size: tuple[int, int]) -> None:
        """Render images of a height and width from now on, in a corner of the buffer."""
        height, width = size
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._pixels = np.empty((height, width, 3), dtype=np.uint8)

    def _average(self, data: mujoco.MjData, request: CameraRequest) -> Image:
        """The mean of images with the camera moved within a pixel and the light within itself."""
        radius = LIGHT_RADIUS * math.sqrt(len(self._offsets))
        total = np.zeros(self._pixels.shape, dtype=np.uint32)
        for pixel_x, pixel_y, light_u, light_v in self._offsets:
            self._update(data, request)
            for lens in self._scene.camera:
                shift_lens(lens, self._pixels.shape, pixel_x, pixel_y)
            for light in self._scene.lights:
                if light.castshadow:
                    _shift_light(light, radius, light_u, light_v)
            self._render()
            total += self._pixels
        half = len(self._offsets) // 2
        return ((total[::-1] + half) // len(self._offsets)).astype(np.uint8)

    def _update(self, data: mujoco.MjData, request: CameraRequest) -> None:
        self._look_from(request)
        mujoco.mjv_updateScene(
            self._model, data, self._option, None, self._view, _EVERYTHING, self._scene
        )
        # Walls and floor pass for transparent, and MuJoCo renders what is transparent twice, unless
        # colours are to be added; they never overlap, so that comes to the same and saves time.
        opacity = self._model.geom_rgba[self._objects, 3]
        clear = bool(np.any((opacity > 0.0) & (opacity < _OPAQUE)))
        self._scene.flags[mujoco.mjtRndFlag.mjRND_ADDITIVE.value] = not clear
        for geom in self._geoms[: self._scene.ngeom]:
            if geom.objid in self._shadowless:
                geom.category = _DECOR  # which casts no shadow
        if self._appearance is not None:
            self._appearance.apply(self._scene, self._geoms)
        self._aim(request)

    def _leave_out(
        self, data: mujoco.MjData, requests: Sequence[CameraRequest]
    ) -> list[list[int]]:
        """Let what casts no shadow that a camera sees cast none.

        Returns:
            What each camera's image comes to the same without, as numbers in the scene. The first
            image is rendered together with the shadows, so it needs all that casts one.
        """
        frustums: list[Array] = []
        for request in requests:
            self._turn_to(data, request)
            frustums.append(frustum(self._scene.camera, request.size))
        lights = self._scene.lights[: self._scene.nlight]
        shadows = [light for light in lights if light.castshadow]
        light = None
        if len(shadows) == 1 and shadows[0].type == _DIRECTIONAL:
            light = np.array(shadows[0].dir, dtype=np.float64)
        geoms = self._geoms[: self._scene.ngeom]
        casting = np.array([geom.category != _DECOR for geom in geoms])
        unseen, unlit = self._visibility.unseen(
            data,
            np.array([geom.objid for geom in geoms]),
            casting,
            np.array(frustums),
            light,
        )
        for number in np.flatnonzero(unlit).tolist():
            geoms[number].category = _DECOR
        unseen[0] &= unlit | ~casting
        return [np.flatnonzero(numbers).tolist() for numbers in unseen]

    def _turn_to(self, data: mujoco.MjData, request: CameraRequest) -> None:
        """Look from another camera at the state that the scene was made of."""
        self._look_from(request)
        mujoco.mjv_updateCamera(self._model, data, self._view, self._scene)
        self._aim(request)

    def _look_from(self, request: CameraRequest) -> None:
        kinds = mujoco.mjtCamera
        is_free = request.number == FREE
        kind = kinds.mjCAMERA_FREE if is_free else kinds.mjCAMERA_FIXED
        self._view.type, self._view.fixedcamid = kind.value, request.number

    def _aim(self, request: CameraRequest) -> None:
        """Put lenses where the engine has none, or where the look has them."""
        if request.pose is not None:
            for lens in self._scene.camera:
                place_lens(lens, request.pose, request.fovy)
        elif self._appearance is not None:
            self._appearance.aim(self._scene, request.number)

    def _render(self, *, new_shadows: bool = True, without: Sequence[int] = ()) -> None:
        """Render the scene into the pixels, with shadows of its own or those of the last one.

        Args:
            new_shadows: Whether the shadows are its own.
            without: Geoms that are left out, as numbers in the scene.
        """
        if new_shadows or not self._shadows[0]:
            self._restore_shadows()
        else:
            self._mujoco_context.shadowFBO = self._mujoco_context.auxFBO[0]
            self._mujoco_context.shadowSize = _DUMMY_SHADOW_MAP
            for geom in self._geoms[: self._scene.ngeom]:
                geom.category = _DECOR
        kinds = [self._geoms[number].type for number in without]
        for number in without:
            self._geoms[number].type = _NOTHING
        mujoco.mjr_render(self._rectangle, self._scene, self._mujoco_context)
        for number, kind in zip(without, kinds, strict=True):
            self._geoms[number].type = kind
        mujoco.mjr_readPixels(self._pixels, None, self._rectangle, self._mujoco_context)

    def _restore_shadows(self) -> None:
        self._mujoco_context.shadowFBO, self._mujoco_context.shadowSize = self._shadows


def lens_offsets(samples: int) -> NDArray[np.float64]:
    """Offsets (samples, 4) of pixel x and y and light u and v, in [-1/2, 1/2) and evenly spread.

    The additive recurrence with powers of the inverse of the root of x^5 = x + 1 fills four
    dimensions evenly with any number of points [Roberts, quasirandom sequences].
    """
    root = 1.1673039782614187
    steps = root ** -np.arange(1.0, 5.0)
    return (0.5 + np.arange(samples)[:, None] * steps) % 1.0 - 0.5


def place_lens(lens: mujoco.MjvGLCamera, pose: SE3, fovy: float) -> None:
    """Put a lens where no camera of the model is; its near and far planes stay."""
    lens.pos[:] = pose.translation
    lens.forward[:], lens.up[:] = -pose.rotation[:, 2], pose.rotation[:, 1]
    top = lens.frustum_near * math.tan(fovy / 2)
    lens.frustum_top, lens.frustum_bottom = top, -top
    lens.frustum_center = lens.frustum_width = 0.0


def _metres(
    depth: NDArray[np.float32], lens: mujoco.MjvGLCamera
) -> NDArray[np.float32]:
    """Distances along the optical axis of a depth buffer that is 0 at the far plane, 1 at the near.

    The buffer holds `near / z` up to a shift and scale, so its floats are as dense as those of z.
    Where nothing is, 0 is given as well.
    """
    near, far = float(lens.frustum_near), float(lens.frustum_far)
    distances = near * far / (depth.astype(np.float64) * (far - near) + near)
    return np.where(depth > 0.0, distances, 0.0).astype(np.float32)


def shift_lens(
    lens: mujoco.MjvGLCamera, shape: tuple[int, ...], x: float, y: float
) -> None:
    """Look by parts of a pixel further to the right and up."""
    height = lens.frustum_top - lens.frustum_bottom
    half_width = lens.frustum_width or height / 2 * shape[1] / shape[0]
    pixel_x, pixel_y = 2 * half_width / shape[1], height / shape[0]
    lens.frustum_center += x * pixel_x
    lens.frustum_bottom += y * pixel_y
    lens.frustum_top += y * pixel_y


def _shift_light(
    light: mujoco.MjvLight,
    size: float,
    u: float,
    v: float,
) -> None:
    """Shine from a point of the light, which is round; u and v are in [-1/2, 1/2)."""
    direction = np.array(light.dir, dtype=np.float64)
    across = np.cross(direction, (1.0, 0.0, 0.0))
    across = across / np.linalg.norm(across)
    along = np.cross(direction, across)
    radius, angle = size * math.sqrt(u + 0.5), 2 * math.pi * v
    direction = direction + radius * (
        math.cos(angle) * across + math.sin(angle) * along
    )
    light.dir[:] = direction / np.linalg.norm(direction)


_RGB = mujoco.mjtTextureRole.mjTEXROLE_RGB.value
_CUBE = mujoco.mjtTexture.mjTEXTURE_CUBE.value
_ROLES = mujoco.mjtTextureRole.mjNTEXROLE.value
_NAMES = 10_000
"""Textures have OpenGL names from here on, which the engine never reaches. A name keeps the kind of
its first texture, so flat textures have even ones and those of objects odd ones."""


def upload(
    model: mujoco.MjModel, context: mujoco.MjrContext, textures: Sequence[Texture]
) -> None:
    """Make textures the materials `model.nmat` and following of a model's context, in their order.

    They are square (n, n, 3), or six squares below each other (6 n, n, 3). The engine uploads
    textures of models only. So they stand in a small model of their own, which is never simulated,
    after as many as the rendered model has.
    """
    if not textures:
        return
    spec = mujoco.MjSpec()
    of_model = np.zeros((1, 1, 3), dtype=np.uint8)
    for number, texels in enumerate([*[of_model] * model.ntex, *textures]):
        height, width, channels = texels.shape
        flat = height == width
        spec.add_texture(
            name=f"{number}",
            type=mujoco.mjtTexture.mjTEXTURE_2D
            if flat
            else mujoco.mjtTexture.mjTEXTURE_CUBE,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
            width=width,
            height=height,
            nchannel=channels,
        )
    holder = spec.compile()
    for number, texels in enumerate(textures, start=model.ntex):
        kind = int(holder.tex_type[number])
        context.texture[number] = _NAMES + 2 * number + (kind == _CUBE)
        context.textureType[number] = kind
        start = holder.tex_adr[number]
        holder.tex_data[start : start + texels.size] = texels.ravel()
        mujoco.mjr_uploadTexture(holder, context, number)
        _filter_quickly(kind, int(context.texture[number]))
        material = model.nmat + number - model.ntex
        roles = np.full(_ROLES, -1)
        roles[_RGB] = number
        context.mat_texid[_ROLES * material : _ROLES * (material + 1)] = roles
        context.mat_texrepeat[2 * material : 2 * (material + 1)] = 1.0
        context.mat_texuniform[material] = 0
    # Freeing the context frees them too.
    context.ntexture = max(context.ntexture, model.ntex + len(textures))


def _filter_quickly(kind: int, name: int) -> None:
    """Take texels of one size where the engine blends two: on a processor a fifth of an image."""
    # Only once a context is there, because this binds PyOpenGL to a library.
    from OpenGL.raw.GL.VERSION import GL_1_0, GL_1_1, GL_1_3

    target = GL_1_3.GL_TEXTURE_CUBE_MAP if kind == _CUBE else GL_1_0.GL_TEXTURE_2D
    GL_1_1.glBindTexture(target, name)
    GL_1_0.glTexParameteri(
        target, GL_1_0.GL_TEXTURE_MIN_FILTER, GL_1_0.GL_LINEAR_MIPMAP_NEAREST
    )
    GL_1_1.glBindTexture(target, 0)
