"""The workcell around the robot: table, pedestal, mount, camera post, room and lights."""

from collections.abc import Callable
from functools import partial
from itertools import product

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.spatial import SE3
from duobench.world.objects.segmentation import MOUNT, ROOM, TABLE as TABLE_PART
from duobench.world.objects.shapes import Colour, hull
from duobench.world.objects.solid import manifold_of, mesh_of
from duobench.world.robot.cameras import HEAD_POSITION
from duobench.world.robot.mounts import DEFAULT_MOUNT, MOUNTS, Mount
from duobench.world.robot.workcell import (
    FLOOR_Z,
    ROOM_HEIGHT,
    ROOM_X,
    ROOM_Y,
    SHADOW_CENTRE,
    TABLE_X,
    TABLE_Y,
)
from duobench.world.scene.meshes import FLAT, add_visual_mesh
from duobench.world.scene.naming import FLOOR, TABLE
from duobench.world.scene.surfaces import (
    SHADOWLESS_GEOM_GROUP,
    CollisionGroup,
    add_box,
    collide_as,
    collide_as_metal,
    visual_only,
)

TABLE_THICKNESS = 0.03
TABLE_FRICTION = 0.8
"""Sliding friction of the table top, plastic on laminate."""
PEDESTAL_SIZE = (0.15, 0.15, 0.24)
PEDESTAL_X = -0.08
"""Column under the mounting block: what an arm can hit; its edges and its middle, in metres."""

_BIRCH = (0.82, 0.74, 0.63, 1.0)
_STEEL = (0.20, 0.21, 0.23, 1.0)
_ALUMINIUM = (0.66, 0.68, 0.70, 1.0)
# MuJoCo lets no shadow fall on what is not quite opaque: the arms' would pass through the table.
_FLOOR = (0.60, 0.62, 0.64, 0.99)
_WALL = (0.72, 0.77, 0.80, 0.99)
_CEILING = (0.88, 0.88, 0.87, 0.99)
_SKIRTING = (0.55, 0.57, 0.59, 1.0)

_BASE_OUTLINE = (
    (0.072, 0.0),
    (0.055, 0.047),
    (0.010, 0.090),
    (-0.006, 0.0945),
    (-0.135, 0.067),
    (-0.154, 0.015),
)
"""Half of the underside of an arm's base, in its frame, in metres [mesh of link 0]."""


def add_workcell(spec: mujoco.MjSpec, mount: Mount) -> None:
    """Add everything that stands still around the robot."""
    for add in _builders(mount).values():
        add(spec)
    _add_lights(spec)


def world_parts() -> list[str]:
    """Part of the workcell that each geom of the world's body is of, in their order.

    They are the same on all mounts, and those of the cameras come after them. Names of geoms would
    be part of the model, which stays what it is to the bit.
    """
    spec = mujoco.MjSpec()
    parts: list[str] = []
    for part, add in _builders(MOUNTS[DEFAULT_MOUNT]).items():
        add(spec)
        parts += [part] * (len(spec.worldbody.geoms) - len(parts))
    return parts


def _add_room(spec: mujoco.MjSpec) -> None:
    world = spec.worldbody
    (x0, x1), (y0, y1) = ROOM_X, ROOM_Y
    x = (x0 + x1) / 2
    y = (y0 + y1) / 2
    half_x = (x1 - x0) / 2
    half_y = (y1 - y0) / 2
    floor_material = _add_matte(spec, "floor", 0.10, floor_light())
    wall_material = _add_matte(spec, "wall", 0.35, wall_light())
    ceiling_material = _add_matte(spec, "ceiling", 0.4)
    ground = world.add_body(name=FLOOR)
    floor = _add_plane(
        ground, SE3.at(x, y, FLOOR_Z), (half_x, half_y), _FLOOR, floor_material
    )
    floor.name = FLOOR
    collide_as(floor, CollisionGroup.FIXTURE)
    above = SE3.at(x, y, FLOOR_Z + ROOM_HEIGHT) @ SE3.about((1, 0, 0), np.pi)
    _add_plane(world, above, (half_x, half_y), _CEILING, ceiling_material)
    half_z = ROOM_HEIGHT / 2
    z = FLOOR_Z + half_z
    upright = SE3.about((0, 1, 0), np.pi / 2)
    for yaw, centre, half_width in (
        (0.0, (x0, y), half_y),
        (np.pi, (x1, y), half_y),
        (np.pi / 2, (x, y0), half_x),
        (-np.pi / 2, (x, y1), half_x),
    ):
        at = SE3.at(*centre, z, yaw=yaw) @ upright
        _add_plane(world, at, (half_z, half_width), _WALL, wall_material)
        # In front of the wall, not through it: nothing may hide behind what is not quite opaque.
        foot = SE3.at(*centre, FLOOR_Z + 0.05, yaw=yaw) @ SE3.at(0.0101)
        add_box(
            world,
            foot,
            (0.02, 2 * half_width, 0.1),
            _SKIRTING,
            shadow=False,
        )


def floor_light() -> NDArray[np.float64]:
    """Brightness of the floor (n, n): the table keeps light away, and so do the walls."""
    n = 128
    (x0, x1), (y0, y1) = ROOM_X, ROOM_Y
    x, y = np.meshgrid(np.linspace(x0, x1, n), np.linspace(y0, y1, n), indexing="xy")
    under = _soft_box(x, TABLE_X, 0.30) * _soft_box(y, TABLE_Y, 0.30)
    corner = np.minimum.reduce([x - x0, x1 - x, y - y0, y1 - y])
    return (1 - 0.55 * under) * (1 - 0.22 * np.exp(-corner / 0.30))


def wall_light() -> NDArray[np.float64]:
    """Brightness of a wall (1, n), from the ceiling down: less towards the floor."""
    height = np.linspace(ROOM_HEIGHT, 0.0, 64)[None, :]
    return 1 - 0.22 * np.exp(-height / 0.6)


def _soft_box(
    x: NDArray[np.float64], ends: tuple[float, float], width: float
) -> NDArray[np.float64]:
    """One between the ends, zero far outside, and a smooth step of a width at each end."""
    inner = np.minimum(x - ends[0], ends[1] - x) / width + 0.5
    inner = np.clip(inner, 0.0, 1.0)
    return inner * inner * (3 - 2 * inner)


def _add_matte(
    spec: mujoco.MjSpec,
    name: str,
    emission: float,
    light: NDArray[np.float64] | None = None,
) -> str:
    """Add a material without highlights, with light of its own and baked-in brightness."""
    material = spec.add_material(
        name=name, specular=0.0, shininess=0.0, emission=emission
    )
    if light is not None:
        grey = np.rint(255 * light).astype(np.uint8)
        spec.add_texture(
            name=name,
            type=mujoco.mjtTexture.mjTEXTURE_2D,
            height=grey.shape[0],
            width=grey.shape[1],
            nchannel=3,
            data=np.repeat(grey.ravel(), 3).tolist(),
        )
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    return name


def _add_table(spec: mujoco.MjSpec) -> None:
    (x0, x1), (y0, y1) = TABLE_X, TABLE_Y
    x = (x0 + x1) / 2
    y = (y0 + y1) / 2
    length = x1 - x0
    width = y1 - y0
    world = spec.worldbody
    table = world.add_body(name=TABLE)
    top = table.add_geom(
        name=TABLE,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=(length / 2, width / 2, TABLE_THICKNESS / 2),
        pos=(x, y, -TABLE_THICKNESS / 2),
        rgba=_BIRCH,
        material=_add_matte(spec, "table", 0.0),
        friction=(TABLE_FRICTION, 0.005, 0.0001),
    )
    # What casts no shadow cannot be speckled by its own; the floor's texture has that of the table.
    top.group = SHADOWLESS_GEOM_GROUP
    collide_as(top, CollisionGroup.FIXTURE)
    height = -FLOOR_Z - TABLE_THICKNESS
    legs_x, legs_y = (x0 + 0.06, x1 - 0.06), (y0 + 0.06, y1 - 0.06)
    for leg_x, leg_y in product(legs_x, legs_y):
        leg = SE3.at(leg_x, leg_y, FLOOR_Z + height / 2)
        add_box(
            world,
            leg,
            (0.05, 0.05, height),
            _STEEL,
            shadow=False,
        )
    rail = -TABLE_THICKNESS - 0.03
    for leg_y in legs_y:
        add_box(
            world,
            SE3.at(x, leg_y, rail),
            (length - 0.12, 0.04, 0.06),
            _STEEL,
            shadow=False,
        )
    for leg_x in legs_x:
        add_box(
            world,
            SE3.at(leg_x, y, rail),
            (0.04, width - 0.12, 0.06),
            _STEEL,
            shadow=False,
        )


def _add_mount(spec: mujoco.MjSpec, mount: Mount) -> None:
    """The column, the block whose two faces carry the arms, and the post of the head camera."""
    world = spec.worldbody
    length, width, height = PEDESTAL_SIZE
    column = add_box(world, SE3.at(PEDESTAL_X, 0.0, height / 2), PEDESTAL_SIZE, _STEEL)
    plate = SE3.at(PEDESTAL_X, 0.0, 0.0075)
    add_box(world, plate, (length + 0.1, width + 0.1, 0.015), _ALUMINIUM)
    outline = np.array([(x, s * y, -0.0005) for x, y in _BASE_OUTLINE for s in (1, -1)])
    faces = [pose.apply(outline) for pose in mount.bases.values()]
    foot = [
        (PEDESTAL_X + s * (length / 2 + 0.005), t * (width / 2 + 0.005), 0.17)
        for s in (1, -1)
        for t in (1, -1)
    ]
    shape = hull(np.vstack([*faces, foot]).tolist())
    mesh = add_visual_mesh(
        spec, "mount/block", mesh_of(manifold_of(shape)), crease=FLAT
    )
    block = world.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh, rgba=_ALUMINIUM
    )
    visual_only(block)
    top = HEAD_POSITION[2] + 0.012
    low = 0.35
    post = add_box(
        world, SE3.at(-0.060, 0.0, (low + top) / 2), (0.03, 0.03, top - low), _STEEL
    )
    at = SE3.at(-0.034, -0.0305, HEAD_POSITION[2] + 0.004)
    holder = add_box(world, at, (0.022, 0.05, 0.012), _STEEL)
    parts = {"column": column, "block": block, "post": post, "holder": holder}
    for name, part in parts.items():
        part.name = f"mount/{name}"
        collide_as_metal(part, CollisionGroup.FIXTURE)


def _builders(mount: Mount) -> dict[str, Callable[[mujoco.MjSpec], None]]:
    """Builders of the parts, by their names in a segmentation."""
    return {
        ROOM: _add_room,
        TABLE_PART: _add_table,
        MOUNT: partial(_add_mount, mount=mount),
    }


def _add_lights(spec: mujoco.MjSpec) -> None:
    """One light with a shadow, and two soft fills without, beside the ambient light of the options.

    The light stands in front of the robot, so that the arms throw their shadows back on themselves
    and not on the objects. It stands straight ahead, because the slope of horizontal surfaces then
    follows one axis of the shadow map, and none is speckled by its own shadow. A level white
    surface has nine tenths of full brightness under the light, and a bit over half in its shadow.
    """
    for name, eye, colour, specular, shadow in (
        ("light", (1.55, 0.00, 2.30), (0.45, 0.44, 0.42), 0.22, True),
        ("window", (-0.8, -2.2, 1.6), (0.20, 0.21, 0.23), 0.0, False),
        ("table_glow", (0.5, 0.0, -1.0), (0.12, 0.10, 0.08), 0.0, False),
    ):
        spec.worldbody.add_light(
            name=name,
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            pos=eye,
            dir=np.array(SHADOW_CENTRE) - eye,
            diffuse=colour,
            specular=(specular, specular, specular),
            castshadow=shadow,
        )


def _add_plane(
    body: mujoco.MjsBody,
    pose: SE3,
    half_size: tuple[float, float],
    rgba: Colour,
    material: str,
) -> mujoco.MjsGeom:
    geom = body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(*half_size, 0.1),
        pos=pose.translation,
        quat=pose.wxyz,
        rgba=rgba,
        material=material,
    )
    visual_only(geom, shadow=False)
    return geom
