"""The model of a Robotiq 2F-85 with its closed linkage.

Link frames, inertias, linkage constraints and contact parameters of the pads are those of MuJoCo
Menagerie's `robotiq_2f85_v4` (BSD-2-Clause). In the gripper's own frame z points out of the flange
and the fingers open along x; it is mounted turned by +90 degrees, so that they open along the
tool's y.
"""

import operator
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import mujoco

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.world.robot.fr3_links import Link, Vector
from duobench.world.robot.gripper import ROBOTIQ_2F85, Gripper
from duobench.world.scene.fingers import add_motor, add_pad
from duobench.world.scene.meshes import add_link, add_mesh
from duobench.world.scene.naming import gripper_name
from duobench.world.scene.surfaces import (
    COLLISION_GEOM_GROUP,
    CONTACT_SOLIMP,
    CONTACT_SOLREF,
    DISTAL,
    collide_unseen,
    visual_only,
)

TENDON_SHARE = 0.485
"""Share of the tendon's force on each driver [Menagerie robotiq_2f85_v4]."""

DRIVER_FORCE = 11.4
"""Force of the actuator, in the tendon's units, with which each pad presses on a 32 mm cube
with the description's force (measured)."""
DRIVER_DAMPING = DRIVER_FORCE / 1.2
"""Damping of the tendon that gives the description's largest speed (measured)."""
SERVO_BAND = 0.02
"""Error in tendon units (radians of the driver) from which on the full force acts: 2 mm of gap."""

METAL = (0.58, 0.58, 0.58, 1.0)
BLACK = (0.149, 0.149, 0.149, 1.0)
PAD_COLOUR = (0.45, 0.45, 0.45, 1.0)

_LINKAGE_ANCHOR = (-0.0179014, -0.00651468, 0.0044)
PAD_SIZE = (0.002, 0.011, 0.009375)
"""Half sizes of one of the two boxes of a pad, in metres."""
PADS = (0.12, 0.13875)
"""Heights in the pad's frame of the two boxes of a pad, in metres."""
FINGERTIP_SIZE = (0.0063, 0.0105, 0.0185)
FINGERTIP_POSITION = (0.0349, 0.0, 0.129)
"""Half size and centre, in the pad's frame and metres, of the box that stands for the metal tongue
behind a pad. It keeps 4 mm behind the pad's face: the tongue's own hull is flush with the pad, and
the two would compete for every grasped object."""
SPRING_LINK_SETBACK = (-0.00125, 0.00082, 0.0)
"""Setback of the hull of the link behind a pad, in its frame and metres: 1.5 mm outwards when the
fingers are 32 mm apart. The pad stands proud of the link, which is hollow there; its convex hull is
not, and took from the pad what reaches deep between the fingers (set back by 1 mm, it still did
with the hexagonal peg)."""


@dataclass(frozen=True, kw_only=True, slots=True)
class FingerLink(Link):
    """One link of the linkage on either side of the gripper."""

    name: str
    """Name within the finger."""
    parent: str
    """Name of the link that carries it."""
    joint: Mapping[str, Any] | None = None
    """Arguments of its hinge, named as MuJoCo names them; None for a rigid one."""
    mesh_position: Vector
    """Position of its meshes in its frame, in metres."""
    mesh_wxyz: Vector
    """Their orientation in its frame, as a quaternion of any length."""
    hull_setback: Vector = (0.0, 0.0, 0.0)
    """Offset of its hull from its image, in its frame and metres."""


_DRIVER_JOINT = {"range": (0.0, 0.9), "armature": 0.005, "damping": (0.1, 0.0, 0.0)}
_FOLLOWER_JOINT = {"range": (-0.872664, 0.9), "armature": 0.001}
_SPRING_JOINT = {
    "range": (-0.29670597283, 0.9),
    "armature": 0.001,
    "stiffness": (0.05, 0.0, 0.0),
    "springref": 2.62,
    "damping": (0.00125, 0.0, 0.0),
}


_FINGER = (
    FingerLink(
        name="driver",
        parent="base",
        position=(-0.0306011, 0.00475, 0.0657045),
        wxyz=(1.0, -1.0, 0.0, 0.0),
        mass=0.00899563,
        centre=(-0.0175297, 0.00165308, -0.00469625),
        axes_wxyz=(-0.469642, 0.469642, -0.528617, 0.528617),
        inertia=(1.72352e-06, 1.60906e-06, 3.22006e-07),
        joint=_DRIVER_JOINT,
        mesh_position=(0.0306011, 0.0549045, -0.0047),
        mesh_wxyz=(1.0, 1.0, 0.0, 0.0),
        visuals=(("driver", METAL),),
    ),
    FingerLink(
        name="coupler",
        parent="driver",
        position=(-0.0314249, 0.00453223, -0.0102),
        wxyz=(0.0, 0.0, 0.0, 1.0),
        mass=0.0140974,
        centre=(0.00367747, 0.01986, 0.0055),
        axes_wxyz=(0.701447, -0.701447, 0.0892884, -0.0892884),
        inertia=(4.16206e-06, 3.52216e-06, 8.88131e-07),
        mesh_position=(-0.062026, -0.0503723, 0.0055),
        mesh_wxyz=(1.0, -1.0, 0.0, 0.0),
        visuals=(("coupler", BLACK),),
    ),
    FingerLink(
        name="spring_link",
        parent="base",
        position=(-0.0127, -0.012, 0.07222),
        wxyz=(1.0, -1.0, 0.0, 0.0),
        mass=0.0221642,
        centre=(-0.0183, -0.0205732, 0.01205),
        axes_wxyz=(0.660941, 0.660941, -0.251309, -0.251309),
        inertia=(8.96853e-06, 6.71733e-06, 2.63931e-06),
        joint=_SPRING_JOINT,
        mesh_position=(0.0127, 0.06142, 0.01205),
        mesh_wxyz=(1.0, 1.0, 0.0, 0.0),
        hull_setback=SPRING_LINK_SETBACK,
        visuals=(("spring_link", BLACK),),
    ),
    FingerLink(
        name="follower",
        parent="spring_link",
        position=(-0.0382079, -0.0425003, 0.00295),
        wxyz=(0.0, -1.0, 0.0, 0.0),
        mass=0.0125222,
        centre=(-0.00852976, -0.0014822, -0.00910001),
        axes_wxyz=(0.359439, 0.359439, 0.608937, 0.608937),
        inertia=(2.67415e-06, 2.4559e-06, 6.02031e-07),
        joint=_FOLLOWER_JOINT,
        mesh_position=(0.0509079, -0.10392, -0.0091),
        mesh_wxyz=(1.0, -1.0, 0.0, 0.0),
        visuals=(("follower", BLACK), ("tongue", METAL)),
    ),
)
"""The four moving bodies of the left finger."""


def _mirrored(link: FingerLink) -> FingerLink:
    """The same link of the other finger, which is turned by half a turn about z."""
    if link.parent != "base":
        return link
    x, y, z = link.position
    return replace(link, position=(-x, -y, z), wxyz=(0.0, 0.0, -1.0, 1.0))


_FINGERS = dict(
    zip(ROBOTIQ_2F85.fingers, (_FINGER, tuple(map(_mirrored, _FINGER))), strict=True)
)
"""Links of the two fingers."""
_BASE = Link(
    mass=0.777441,
    centre=(7.77116e-05, 8.42713e-05, 0.0311656),
    axes_wxyz=(0.704758, -0.00373684, -0.00570287, 0.709415),
    inertia=(0.000260285, 0.000225381, 0.000152708),
)
_BASE_VISUALS: tuple[tuple[str, Vector, Vector, Vector], ...] = (
    ("base", (0, 0, 0.0108), (0, 0, 0, 1), BLACK),
    ("base_coupling", (0, 0, 0.004), (1, -1, 0, 0), BLACK),
    ("c-a01-85-open", (0, 0, 0.0108), (1, 0, 0, 0), METAL),
)
_COUPLING = ("base_coupling", "c-a01-85-open")
_PAD = Link(position=(-0.0377897, -0.103916, -0.0091), wxyz=(1.0, -1.0, 0.0, 0.0))
_FOLLOWER_FROM_PAD = SE3.from_wxyz(_PAD.wxyz, _PAD.position)
_PAD_OFFSET = 0.043258
_PAD_MASS = 0.00175


def add_gripper(
    spec: mujoco.MjSpec,
    gripper: Gripper,
    side: Side,
    body: mujoco.MjsBody,
    flange: SE3,
) -> None:
    """Hang a gripper with its linkage, constraints and actuator on the flange of a body."""
    prefix = gripper_name(side)
    base = add_link(body, f"{prefix}/base", _BASE)
    pose = flange @ gripper.flange_from_base
    base.pos, base.quat = pose.translation, pose.wxyz
    for name, position, wxyz, rgba in _BASE_VISUALS:
        image = add_mesh(spec, base, f"robotiq_2f85/{name}:visual", position, wxyz)
        image.rgba = rgba
        # The coupling is a ring between flange and base, which cast its shadow.
        visual_only(image, shadow=name not in _COUPLING)
    _, position, wxyz, _ = _BASE_VISUALS[0]
    collide_unseen(
        add_mesh(spec, base, "robotiq_2f85/base:hull", position, wxyz), DISTAL[side]
    )
    for finger, parts in _FINGERS.items():
        _add_finger(spec, gripper, side, finger, parts, base)
    _add_constraints(spec, gripper, side)


def _add_finger(
    spec: mujoco.MjSpec,
    gripper: Gripper,
    side: Side,
    finger: str,
    parts: tuple[FingerLink, ...],
    base: mujoco.MjsBody,
) -> None:
    prefix = f"{gripper_name(side)}/{finger}"
    bodies = {"base": base}
    for part in parts:
        name = f"{prefix}_{part.name}"
        body = bodies[part.name] = add_link(bodies[part.parent], name, part)
        if part.joint is not None:
            body.add_joint(
                name=name,
                axis=(0, 0, 1),
                limited=True,
                solref_limit=CONTACT_SOLREF,
                solimp_limit=CONTACT_SOLIMP,
                **part.joint,
            )
        position, wxyz = part.mesh_position, part.mesh_wxyz
        for name, rgba in part.visuals:
            mesh = f"robotiq_2f85/{name}"
            image = add_mesh(spec, body, f"{mesh}:visual", position, wxyz)
            image.rgba = rgba
            visual_only(image)
            if name != "tongue":
                back = tuple(map(operator.add, position, part.hull_setback))
                collide_unseen(
                    add_mesh(spec, body, f"{mesh}:hull", back, wxyz), DISTAL[side]
                )
    # The rubber pad, and the metal tongue behind it.
    pad = add_link(bodies["follower"], f"{prefix}_{gripper.pad}", _PAD)
    fingertip = bodies["follower"].add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=FINGERTIP_SIZE,
        pos=(_FOLLOWER_FROM_PAD @ SE3.at(*FINGERTIP_POSITION)).translation,
        quat=_FOLLOWER_FROM_PAD.wxyz,
    )
    collide_unseen(fingertip, DISTAL[side])
    for height in PADS:
        at = (_PAD_OFFSET, 0, height)
        box = add_pad(pad, side, PAD_SIZE, at, _PAD_MASS, PAD_COLOUR)
        box.group = COLLISION_GEOM_GROUP


def _add_constraints(spec: mujoco.MjSpec, gripper: Gripper, side: Side) -> None:
    """Close the two four-bar linkages, couple the drivers, and drive both through one tendon."""
    prefix = gripper_name(side)
    for finger in gripper.fingers:
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT,
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            name1=f"{prefix}/{finger}_follower",
            name2=f"{prefix}/{finger}_coupler",
            data=[*_LINKAGE_ANCHOR, *[0.0] * 9],
            solref=CONTACT_SOLREF,
            solimp=CONTACT_SOLIMP,
        )
    add_motor(
        spec,
        gripper,
        side,
        share=TENDON_SHARE,
        force=DRIVER_FORCE,
        damping=DRIVER_DAMPING,
        band=SERVO_BAND,
    )
