"""The station around the robot: table, pedestal, mount, camera post, floor, walls and lights.

The table frame is the world frame: origin under the duo mount on the table top, x away from the
robot, y to its left, z up.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from duobench.scene.cameras import HEAD_POSITION
from duobench.scene.filters import Group, collide_as
from duobench.scene.fr3 import BASE_POSES
from duobench.scene.naming import TABLE
from duobench.spatial import SE3

FLOOR_Z = -0.8095
"""Height of the floor in the table frame, in metres [facts of the platform]."""
TABLE_X = (-0.30, 1.10)
"""Front and back edge of the table top; the arms reach x 0.15 to 1.05 [facts of the platform]."""
TABLE_Y = (-0.75, 0.75)
"""Right and left edge of the table top; the arms reach |y| up to 0.65 [facts of the platform]."""
TABLE_THICKNESS = 0.03
TABLE_FRICTION = 0.8
"""Sliding friction of the table top, plastic on laminate."""

_TABLE_COLOUR = (0.80, 0.76, 0.69, 1.0)
_STEEL = (0.42, 0.44, 0.47, 1.0)
_ALUMINIUM = (0.66, 0.68, 0.70, 1.0)
_FLOOR_COLOUR = (0.55, 0.57, 0.60, 1.0)
_WALL_COLOUR = (0.88, 0.89, 0.90, 1.0)

_BACK_WALL_X = -0.95
_FAR_WALL_X = 3.2
_ROOM_HALF_WIDTH = 3.0
_WALL_HEIGHT = 2.6

SCENE_CENTRE = (0.4, 0.0, 0.1)
SCENE_EXTENT = 1.4
"""Centre and radius (metres) of what lights and shadows must cover; fixed, so that the picture
does not depend on a task's objects."""


def add_station(spec: mujoco.MjSpec) -> None:
    """Add everything that stands still around the robot."""
    _add_room(spec.worldbody)
    _add_table(spec.worldbody)
    _add_mount(spec.worldbody)
    _add_lights(spec)


def _add_room(world: mujoco.MjsBody) -> None:
    floor = world.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(_ROOM_HALF_WIDTH, _ROOM_HALF_WIDTH, 0.1),
        pos=(0.8, 0, FLOOR_Z),
        rgba=_FLOOR_COLOUR,
    )
    collide_as(floor, Group.FIXTURE)
    for x in (_BACK_WALL_X, _FAR_WALL_X):
        _add_box(
            world,
            SE3.at(x, 0.0, FLOOR_Z + _WALL_HEIGHT / 2),
            (0.02, _ROOM_HALF_WIDTH, _WALL_HEIGHT / 2),
            _WALL_COLOUR,
        )


def _add_table(world: mujoco.MjsBody) -> None:
    (x0, x1), (y0, y1) = TABLE_X, TABLE_Y
    table = world.add_body(name=TABLE)
    top = table.add_geom(
        name=TABLE,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=((x1 - x0) / 2, (y1 - y0) / 2, TABLE_THICKNESS / 2),
        pos=((x0 + x1) / 2, (y0 + y1) / 2, -TABLE_THICKNESS / 2),
        rgba=_TABLE_COLOUR,
        friction=(TABLE_FRICTION, 0.005, 0.0001),
    )
    collide_as(top, Group.FIXTURE)
    height = -FLOOR_Z - TABLE_THICKNESS
    for x in (x0 + 0.05, x1 - 0.05):
        for y in (y0 + 0.05, y1 - 0.05):
            leg = SE3.at(x, y, FLOOR_Z + height / 2)
            _add_box(world, leg, (0.025, 0.025, height / 2), _STEEL)


def _add_mount(world: mujoco.MjsBody) -> None:
    """The pedestal, the mounting block whose two faces carry the arms, and the camera post."""
    pedestal_height = 0.24
    pedestal = _add_box(
        world,
        SE3.at(-0.08, 0.0, pedestal_height / 2),
        (0.075, 0.075, pedestal_height / 2),
        _STEEL,
    )
    collide_as(pedestal, Group.FIXTURE)
    for pose in BASE_POSES.values():
        block = pose @ SE3(np.eye(3), np.array([-0.05, 0.0, -0.012]))
        _add_box(world, block, (0.09, 0.08, 0.012), _ALUMINIUM)
    _add_box(world, SE3.at(-0.055, 0.0, 0.285), (0.06, 0.05, 0.06), _ALUMINIUM)
    top = HEAD_POSITION[2] - 0.02
    foot = 0.33
    _add_box(
        world, SE3.at(-0.05, 0.0, (foot + top) / 2), (0.0125, 0.0125, (top - foot) / 2), _STEEL
    )
    arm = SE3.at(-0.025, -0.01, HEAD_POSITION[2] - 0.026) @ SE3.about((0, 1, 0), 0.0)
    _add_box(world, arm, (0.036, 0.0125, 0.006), _STEEL)


def _add_lights(spec: mujoco.MjSpec) -> None:
    """One light with a shadow from above, one soft fill without, and ambient light."""
    spec.visual.headlight.ambient = (0.32, 0.32, 0.32)
    spec.visual.headlight.diffuse = (0.14, 0.14, 0.14)
    spec.visual.headlight.specular = (0.0, 0.0, 0.0)
    spec.worldbody.add_light(
        name="key",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=(0.1, 0.5, 2.2),
        dir=(0.16, -0.24, -1.0),
        diffuse=(0.58, 0.57, 0.54),
        specular=(0.15, 0.15, 0.15),
        castshadow=True,
    )
    spec.worldbody.add_light(
        name="fill",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=(2.0, -1.5, 1.6),
        dir=(-math.cos(0.7), 0.6, -math.sin(0.7)),
        diffuse=(0.18, 0.19, 0.21),
        specular=(0.0, 0.0, 0.0),
        castshadow=False,
    )


def _add_box(
    body: mujoco.MjsBody,
    pose: SE3,
    half_size: tuple[float, float, float],
    rgba: tuple[float, float, float, float],
) -> mujoco.MjsGeom:
    return body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=half_size,
        pos=pose.translation,
        quat=pose.wxyz,
        rgba=rgba,
        contype=0,
        conaffinity=0,
        group=1,
    )
