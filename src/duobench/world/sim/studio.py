"""Images by MuJoCo's physically based renderer, Filament, in the process that renders with it.

A look's materials, furniture, lights and cameras are put into its scene; the light from all around
is made by `looks.surroundings`. Its own tone mapping would make an image depend on those before it,
by a dither that counts them. So it gives the light as it is, in eight bits, once for what is dark
and once for what is bright, and the tone curve is ours.
"""

import os
import re
import sys
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.backend import RGB, Image
from duobench.core.machine import is_software_renderer
from duobench.world.looks import effects
from duobench.world.looks.look import Light, Look
from duobench.world.looks.surroundings import image_light
from duobench.world.robot.workcell import SHADOW_CENTRE
from duobench.world.scene.fine_meshes import COVER, FINISHES, FineRobot
from duobench.world.scene.naming import FLOOR
from duobench.world.sim.appearance import Appearance, Texture, parts_of
from duobench.world.sim.offscreen import (
    FREE,
    VISIBLE_GROUPS,
    CameraRequest,
    Images,
    lens_offsets,
    place_lens,
    shift_lens,
)
from duobench.world.sim.opengl import VULKAN, RenderingInfo

mjrf: Any = import_module("mujoco.mjrf")
_FINER = 2
"""Factor on height and width of what is rendered, so that edges are smooth: the renderer's own
antialiasing has no effect outside a window."""
KEY = Light(position=(0.95, 1.05, 2.70), colour=(0.45, 0.44, 0.42), shadow=True)
"""The light of a look that has none of its own."""
KEY_LUX, AROUND_LUX = 60_000.0, 19_000.0
"""Light of the key at the brightness of `KEY`, and from all around."""
KEY_METRES = 0.08
"""Radius of the key, for its shadows' edges."""
_KEY_BRIGHTNESS = 0.437
_DISTANCE = 2.7
"""From a light without shadows to the middle of the workcell in metres."""
_SHADOW_MAP = 1024
_SETTINGS = """<mujoco><custom>
  <text name="filament.shadows.type" data="{}"/>
</custom></mujoco>"""
"""Settings of a scene, in which the kind of shadows is to be filled in."""
_SHARP, _SOFT = "pcf", "pcss"
"""Shadows for policies, and for people, whose edges are softer the further they fall: those take
four times as long."""
_DARK, _BRIGHT = 0.40, 1.60
"""Light that fills eight bits, of the image for what is dark and of that for what is bright."""
_FULL = 250
"""Number up to which the image for what is dark is taken."""
_SAMPLES = 8
"""Samples of the classic renderer that one image here is worth."""
_SHOULDER = 0.60
"""Light from which on the tone curve bends, so that nothing burns out."""
_DEVICE = re.compile(r"Selected physical device '(.*?)'")
_LENS = (
    "pos",
    "forward",
    "up",
    "frustum_center",
    "frustum_width",
    "frustum_bottom",
    "frustum_top",
    "frustum_near",
    "frustum_far",
)
"""What the renderer's camera takes of MuJoCo's."""
_TRANSPARENT = 0.98
"""Opacity from which on a geom is opaque."""
_METAL_PATCH = 0.30
"""Side in metres of the texture on a mesh."""


class Finish(NamedTuple):
    """Surface of a geom, beside its colour."""

    mirror: float
    """Share of the light that it mirrors when it is seen from straight ahead."""
    gloss: float
    """Sharpness of what it mirrors, 0 to 1."""


_FINISHES = {
    "table": Finish(0.04, 0.55),
    "floor": Finish(0.04, 0.45),
    "walls": Finish(0.02, 0.10),
    "ceiling": Finish(0.02, 0.05),
    "robot": Finish(0.05, 0.66),
    "metal": Finish(0.55, 0.62),
}
_PLASTIC = Finish(0.04, 0.52)
"""Finish of all else."""
_METAL_BODY = 0.6
"""Share of a metal's colour that it scatters; the rest it mirrors."""


def _open_device() -> tuple[Any, str]:
    """A context, and the name of what renders; a failure ends the process.

    Each renderer has its own: a context frees the materials that its last image did not show,
    though another scene has them.
    """
    import_module("mujoco.studio.window")  # registers the materials
    sys.stdout.flush()
    with os.fdopen(os.memfd_create("duobench-log"), "w+b") as log:
        kept = os.dup(1)
        os.dup2(log.fileno(), 1)
        config = mjrf.ContextConfig(
            graphics_api=mjrf.GraphicsApi.GRAPHICS_API_VULKAN, software_rendering=False
        )
        context = mjrf.Context(config)
        os.dup2(kept, 1)
        os.close(kept)
        log.seek(0)
        found = _DEVICE.search(log.read().decode(errors="replace"))
    context.set_clear_color([0.0, 0.0, 0.0])
    return context, found[1] if found else "unknown"


@cache
def studio_info() -> RenderingInfo:
    """Renderer of the images of this process."""
    _, name = _open_device()
    return RenderingInfo(
        backend=VULKAN,
        renderer=f"Filament on {name}",
        vendor="MuJoCo",
        version=mujoco.__version__,
        software=is_software_renderer(name),
    )


class StudioRenderer:
    """A scene of a model, and what it is rendered into."""

    def __init__(
        self, model: mujoco.MjModel, height: int, width: int, samples: int
    ) -> None:
        self._model = model
        self._context, _ = _open_device()
        self._scene = self._context.create_scene(mjrf.SceneParams())
        settings = _SETTINGS.format(_SOFT if samples > 1 else _SHARP)
        self._scene.configure_from_model(mujoco.MjModel.from_xml_string(settings))
        self._geoms = self._renderables(model)
        self._robot = FineRobot(model)
        self._fine_geoms = self._renderables(self._robot.model)
        self._fine_materials: list[Any] = []
        option = mujoco.MjvOption()
        option.geomgroup[:] = np.arange(len(option.geomgroup)) < VISIBLE_GROUPS
        option.sitegroup[:] = 0
        self._geoms.set_options(option)
        self._part_of = {
            geom: part for part, geoms in parts_of(model).items() for geom in geoms
        }
        textured = np.append(np.any(model.mat_texid >= 0, axis=1), False)
        self._own_textures = {
            geom: self._geom(geom).get_material().color_texture
            for geom in np.flatnonzero(textured[model.geom_matid]).tolist()
            if geom not in self._part_of
        }
        """Of objects, by geom."""
        seen = model.geom_group < VISIBLE_GROUPS
        for geom in set(self._robot.geoms[seen[self._robot.geoms]].tolist()):
            self._scene.remove_renderable(self._geom(geom))
        self._planes = {
            geom: self._plane(geom)
            for geom in np.flatnonzero(model.geom_type == _PLANE).tolist()
        }
        self._sky = self._surroundings()
        self._around = self._add_light(
            mjrf.LightParams(type=mjrf.LightType.LIGHT_IMAGE, texture=self._sky)
        )
        self._lights: list[tuple[Any, float]] = []
        self._ambient = AROUND_LUX
        self._target = self._context.create_render_target(
            mjrf.RenderTargetConfig(color_format=mjrf.PixelFormat.PIXEL_FORMAT_RGB8)
        )
        self._read = mjrf.ReadRequest(target=self._target)
        self._request = mjrf.RenderRequest(scene=self._scene, target=self._target)
        self._request.post_processing = False
        self._size = 0, 0
        self._set_size((height, width))
        self._offsets = lens_offsets(-(-samples // _SAMPLES))
        self._view = mujoco.MjvCamera()
        self._view.type = mujoco.mjtCamera.mjCAMERA_FIXED.value
        self._furniture: list[Any] = []
        self._textures: list[Any] = []
        self._materials: dict[int, Any] = {}
        self._hidden: set[int] = set()
        self._shown = b""
        self.set_appearance(Appearance(model, Look()))

    def set_appearance(self, appearance: Appearance | None) -> None:
        """Render in a look from now on."""
        self._appearance = appearance or Appearance(self._model, Look())
        self._shown = b""
        look = self._appearance.look
        for light, _ in self._lights:
            self._scene.remove_light(light)
        chosen = look.lights or (KEY,)
        first = next((light for light in chosen if light.shadow), chosen[0])
        self._lights = [self._lamp(light, first) for light in chosen]
        share = self._appearance.ambient_share
        self._ambient = AROUND_LUX * (1.0 if share is None else share)
        for piece in self._furniture:
            self._scene.remove_renderable(piece)
        self._furniture = [self._piece(*piece) for piece in self._appearance.pieces]

    def render(self, data: mujoco.MjData, requests: Sequence[CameraRequest]) -> Images:
        """Colours of one state; the other kinds are left to the classic renderer."""
        colours = self._model.geom_rgba.tobytes()
        if colours != self._shown:
            self._make_materials()
            self._shown = colours
        self._geoms.update(data)
        for geom, material in self._materials.items():
            plane = self._planes.get(geom)
            if plane is not None:
                plane.set_pose(data.geom_xpos[geom], data.geom_xmat[geom])
            (plane or self._geom(geom)).set_material(material)
        self._robot.follow(data)
        self._fine_geoms.update(self._robot.data)
        for geom, material in enumerate(self._fine_materials):
            _of(self._fine_geoms, geom).set_material(material)
        look = self._appearance.look
        images: Images = {}
        for request in requests:
            self._set_size(request.size)
            camera = request.name if request.number == FREE else request.number
            image = self._image(data, request)
            image = effects.apply(look, image, data.time, data.qpos, camera)
            images.setdefault(request.name, {})[RGB] = image
        return images

    def free(self) -> None:
        """Let go of everything, what hangs on others first."""
        self._materials.clear()
        self._fine_materials.clear()
        for name in ("_request", "_read", "_target", "_furniture", "_planes"):
            delattr(self, name)
        for name in ("_own_textures", "_fine_geoms", "_geoms"):
            delattr(self, name)
        for name in ("_lights", "_around", "_sky", "_textures", "_scene", "_context"):
            delattr(self, name)

    def make_current(self) -> None:
        """Nothing: a context is named in every call."""

    def _set_size(self, size: tuple[int, int]) -> None:
        """Render images of a height and width from now on."""
        if size == self._size:
            return
        self._size = size
        height, width = (length * _FINER for length in size)
        self._target.resize(width, height)
        self._pixels = np.zeros((height, width, 3), dtype=np.uint8)
        self._read.set_buffer(self._pixels)
        self._request.viewport = mjrf.Rect(left=0, bottom=0, width=width, height=height)

    def _image(self, data: mujoco.MjData, request: CameraRequest) -> Image:
        """The light that reaches a camera, through the tone curve."""
        total = np.zeros(self._pixels.shape, dtype=np.float32)
        for across, up, _, _ in self._offsets:
            self._view.fixedcamid = max(request.number, 0)
            lens = mujoco.mjv_camera2GLCamera(self._model, data, self._view)
            if request.pose is None:
                self._appearance.aim_lens(lens, request.number)
            else:
                place_lens(lens, request.pose, request.fovy)
            shift_lens(lens, self._pixels.shape, across, up)
            self._request.camera = mjrf.Camera(
                **{name: getattr(lens, name) for name in _LENS}
            )
            dark = self._exposed(_DARK)
            bright = self._exposed(_BRIGHT)
            light = np.where(dark < _FULL, dark * (_DARK / _BRIGHT), bright)
            total += light.astype(np.float32)
        height, width, _ = total.shape
        cells = total.reshape(height // _FINER, _FINER, width // _FINER, _FINER, 3)
        share = _BRIGHT / 255 / len(self._offsets) / _FINER**2
        return _developed(cells.sum(axis=(1, 3)) * share)

    def _exposed(self, full: float) -> Image:
        """An image in which a light fills the eight bits."""
        self._around.set_intensity(self._ambient / full)
        for light, intensity in self._lights:
            light.set_intensity(intensity / full)
        frame = self._context.render([self._request], [self._read])
        self._context.wait_for_frame(frame)
        return self._pixels.copy()

    def _renderables(self, model: mujoco.MjModel) -> Any:
        """What a model shows, in the scene."""
        resources = mjrf.ModelResources(self._context, model)
        return mjrf.ModelRenderables(self._scene, resources)

    def _geom(self, geom: int) -> Any:
        return _of(self._geoms, geom)

    def _plane(self, geom: int) -> Any:
        """A plane in the place of the model's, which casts no shadow: walls keep no light out."""
        self._scene.remove_renderable(self._geom(geom))
        size = *self._model.geom_size[geom][:2].tolist(), 1.0
        receives = self._model.geom(geom).name == FLOOR
        return self._shape(_PLANE, size, receives=receives)

    def _piece(
        self, kind: int, size: Any, position: Any, rotation: Any, rgba: Any
    ) -> Any:
        """A piece of furniture."""
        if kind == mujoco.mjtGeom.mjGEOM_CYLINDER.value:
            size = size[0], size[0], size[1]
        piece = self._shape(kind, size, receives=True)
        piece.set_pose(position, rotation)
        piece.set_material(_surface(rgba, _PLASTIC))
        return piece

    def _shape(self, kind: int, size: Any, *, receives: bool) -> Any:
        """Something without a shadow of its own."""
        params = mjrf.RenderableParams(cast_shadow=False, receive_shadow=receives)
        shape = self._context.create_renderable(params)
        quality = self._model.vis.quality
        shape.set_geom_mesh(
            mujoco.mjtGeom(kind), quality.numstacks, quality.numslices, quality.numquads
        )
        shape.set_size(np.array(size, dtype=np.float32))
        self._scene.add_renderable(shape)
        return shape

    def _lamp(self, light: Light, main: Light) -> tuple[Any, float]:
        """A light of a look, and its strength; the renderer has one that is distant."""
        brightness = float(np.mean(light.colour))
        intensity = KEY_LUX * brightness / _KEY_BRIGHTNESS
        colour = np.array(light.colour, np.float32) / max(brightness, 1e-6)
        distant = light is main
        if not distant:
            intensity *= _DISTANCE**2
        kind = mjrf.LightType
        lamp = self._add_light(
            mjrf.LightParams(
                type=kind.LIGHT_DIRECTIONAL if distant else kind.LIGHT_POINT,
                color=colour,
                cast_shadow=distant and light.shadow,
                shadow_map_size=_SHADOW_MAP,
                bulb_radius=KEY_METRES,
            )
        )
        direction = np.array(SHADOW_CENTRE) - light.position
        direction /= np.sqrt(np.sum(direction**2))
        lamp.set_pose(SHADOW_CENTRE - _DISTANCE * direction, direction)
        return lamp, intensity

    def _add_light(self, params: Any) -> Any:
        light = self._context.create_light(params)
        self._scene.add_light(light)
        return light

    def _surroundings(self) -> Any:
        config = mjrf.TextureConfig(
            width=1,
            height=1,
            format=mjrf.PixelFormat.PIXEL_FORMAT_KTX,
            sampler_type=mjrf.SamplerType.TEXTURE_CUBE,
        )
        return self._uploaded(config, image_light())

    def _texture(self, texels: Texture) -> Any:
        """A texture of a look, as light: only then it is made smaller for what is far."""
        height, width, _ = texels.shape
        kinds = mjrf.SamplerType
        config = mjrf.TextureConfig(
            width=width,
            height=height,
            format=mjrf.PixelFormat.PIXEL_FORMAT_RGB8,
            color_space=mjrf.ColorSpace.COLORSPACE_LINEAR,
            sampler_type=kinds.TEXTURE_2D if width == height else kinds.TEXTURE_CUBE,
        )
        light = np.rint(255 * (np.arange(256) / 255) ** effects.GAMMA).astype(np.uint8)
        return self._uploaded(config, light[texels].tobytes())

    def _uploaded(self, config: Any, content: bytes) -> Any:
        texture = self._context.create_texture(config)
        data = mjrf.TextureData()
        data.set_image(content)
        texture.upload(data)
        return texture

    def _make_materials(self) -> None:
        """Make the materials of all geoms but those that have a texture of the model's own."""
        self._textures = [self._texture(each) for each in self._appearance.textures]
        model = self._model
        self._materials = {}
        seen = model.geom_group < VISIBLE_GROUPS
        hidden = set(np.flatnonzero(seen & (model.geom_rgba[:, 3] == 0.0)).tolist())
        for geom in hidden - self._hidden:
            self._scene.remove_renderable(self._geom(geom))
        for geom in self._hidden - hidden:
            self._scene.add_renderable(self._geom(geom))
        self._hidden = hidden
        self._fine_materials = [
            self._fine_material(geom, finish)
            for geom, finish in zip(
                self._robot.geoms.tolist(), self._robot.finishes, strict=True
            )
        ]
        for geom in np.flatnonzero(seen).tolist():
            chosen = self._appearance.by_geom.get(geom)
            if chosen is not None or geom not in self._own_textures:
                self._materials[geom] = self._material(geom, self._part_of.get(geom))

    def _fine_material(self, geom: int, name: str) -> Any:
        """Material of a fine image of a geom; a look paints the covers."""
        if name == COVER and geom in self._appearance.by_geom:
            return self._material(geom, "robot")
        finish = FINISHES[name]
        red, green, blue, opacity = finish.rgba
        body = _METAL_BODY if finish.metallic else 1.0
        mirror = _FINISHES["metal"].mirror if finish.metallic else _PLASTIC.mirror
        rgba = red * body, green * body, blue * body, opacity
        return _surface(rgba, Finish(mirror, 1 - finish.roughness))

    def _material(self, geom: int, part: str | None) -> Any:
        red, green, blue, opacity = self._model.geom_rgba[geom].tolist()
        chosen = self._appearance.by_geom.get(geom)
        if chosen is not None and chosen.rgb is not None:
            red, green, blue = chosen.rgb
        finish = _FINISHES.get(part or "", _PLASTIC)
        body = _METAL_BODY if part == "metal" else 1.0
        opacity = 1.0 if opacity > _TRANSPARENT else opacity
        material = _surface([red * body, green * body, blue * body, opacity], finish)
        if chosen is not None and chosen.texture is not None:
            texels = self._appearance.textures[chosen.texture]
            material.color_texture = self._textures[chosen.texture]
            if texels.shape[0] == texels.shape[1]:
                mesh = self._model.geom_type[geom] == _MESH
                repeat = 1 / _METAL_PATCH if mesh else 0.5
                material.uv_scale = np.array([repeat, -repeat, 1.0], np.float32)
                material.uv_offset = np.array([-0.5, -0.5, 0.0], np.float32)
        elif geom in self._own_textures:
            material.color_texture = self._own_textures[geom]
        return material


_PLANE = mujoco.mjtGeom.mjGEOM_PLANE.value
_MESH = mujoco.mjtGeom.mjGEOM_MESH.value


def _of(renderables: Any, geom: int) -> Any:
    return renderables.get_renderable(mujoco.mjtObj.mjOBJ_GEOM, geom, -1)


def _surface(rgba: Sequence[float], finish: Finish) -> Any:
    return mjrf.Material(
        color=np.array(rgba, np.float32),
        specular=finish.mirror,
        glossiness=finish.gloss,
    )


def _developed(light: NDArray[np.float32]) -> Image:
    """An image of a light: straight up to the shoulder, then ever flatter."""
    rest = 1 - _SHOULDER
    bent = 1 - rest * np.exp(-(light - _SHOULDER) / rest)
    light = np.where(light > _SHOULDER, bent, light)
    return np.rint(255 * light ** (1 / effects.GAMMA)).astype(np.uint8)
