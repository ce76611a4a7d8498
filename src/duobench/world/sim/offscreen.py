"""Offscreen rendering with MuJoCo, in the process that renders for a `Renderer`."""

import json
import math
import os
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.backend import Image
from duobench.core.errors import RenderingError
from duobench.world.looks import effects
from duobench.world.looks.look import MAX_CLUTTER
from duobench.world.scene.surfaces import SHADOWLESS_GEOM_GROUP
from duobench.world.sim.appearance import Appearance, Texture
from duobench.world.sim.opengl import in_words, info_of, open_context

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
_EFFECTS = [
    mujoco.mjtRndFlag.mjRND_REFLECTION.value,
    mujoco.mjtRndFlag.mjRND_SKYBOX.value,
    mujoco.mjtRndFlag.mjRND_HAZE.value,
    mujoco.mjtRndFlag.mjRND_FOG.value,
]
_PROBE_MODEL = (
    '<mujoco><worldbody><camera pos="0 0 1"/><light pos="0 0 1"/><geom size="0.3"/></worldbody>'
    "</mujoco>"
)
_SEGMENTATION = [
    mujoco.mjtRndFlag.mjRND_SEGMENT.value,
    mujoco.mjtRndFlag.mjRND_IDCOLOR.value,
]


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
    image = renderer.render(data, {"": 0})[""]
    while time.monotonic() < deadline:
        image = renderer.render(data, {"": 0})[""]
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
        self._view = mujoco.MjvCamera()
        self._view.type = mujoco.mjtCamera.mjCAMERA_FIXED.value
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._pixels = np.empty((height, width, 3), dtype=np.uint8)
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

    def render(
        self, data: mujoco.MjData, cameras: Mapping[str, int]
    ) -> dict[str, Image]:
        """One image of each camera; their numbers by name."""
        images = {}
        for name, camera in cameras.items():
            if len(self._offsets) > 1:
                image = self._average(data, camera)
            else:
                (self._turn_to if images else self._update)(data, camera)
                self._render(new_shadows=not images)
                image = self._pixels[::-1].copy()
            if self._appearance is not None:
                look = self._appearance.look
                image = effects.apply(look, image, data.time, data.qpos, camera)
            images[name] = image
        return images

    def segment(self, data: mujoco.MjData, camera: int) -> NDArray[np.int32]:
        """Geom ids by pixel."""
        self._update(data, camera)
        self._scene.flags[_SEGMENTATION] = 1
        try:
            self._render()
        finally:
            self._scene.flags[_SEGMENTATION] = 0
        numbers = self._pixels[::-1].astype(np.int32) @ (1, 1 << 8, 1 << 16)
        ids = np.full(self._scene.ngeom + 1, -1, dtype=np.int32)
        for geom in self._geoms[: self._scene.ngeom]:
            ids[geom.segid + 1] = geom.objid
        return ids[numbers]

    def free(self) -> None:
        """Give back everything that was made with OpenGL."""
        self._restore_shadows()
        self._mujoco_context.free()
        self._context.free()

    def _average(self, data: mujoco.MjData, camera: int) -> Image:
        """The mean of images with the camera moved within a pixel and the light within itself."""
        radius = LIGHT_RADIUS * math.sqrt(len(self._offsets))
        total = np.zeros(self._pixels.shape, dtype=np.uint32)
        for pixel_x, pixel_y, light_u, light_v in self._offsets:
            self._update(data, camera)
            for lens in self._scene.camera:
                shift_lens(lens, self._pixels.shape, pixel_x, pixel_y)
            for light in self._scene.lights:
                if light.castshadow:
                    _shift_light(light, radius, light_u, light_v)
            self._render()
            total += self._pixels
        half = len(self._offsets) // 2
        return ((total[::-1] + half) // len(self._offsets)).astype(np.uint8)

    def _update(self, data: mujoco.MjData, camera: int) -> None:
        self._view.fixedcamid = camera
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
            self._appearance.apply(self._scene, self._geoms, camera)

    def _turn_to(self, data: mujoco.MjData, camera: int) -> None:
        """Look from another camera at the state that the scene was made of."""
        self._view.fixedcamid = camera
        mujoco.mjv_updateCamera(self._model, data, self._view, self._scene)
        if self._appearance is not None:
            self._appearance.aim(self._scene, camera)

    def _render(self, *, new_shadows: bool = True) -> None:
        """Render the scene into the pixels, with shadows of its own or those of the last one."""
        if new_shadows or not self._shadows[0]:
            self._restore_shadows()
        else:
            self._mujoco_context.shadowFBO = self._mujoco_context.auxFBO[0]
            self._mujoco_context.shadowSize = _DUMMY_SHADOW_MAP
            for geom in self._geoms[: self._scene.ngeom]:
                geom.category = _DECOR
        mujoco.mjr_render(self._rectangle, self._scene, self._mujoco_context)
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
