"""The model of a Franka Hand: two fingers on slides.

Frames, masses, inertias and images are those of MuJoCo Menagerie's `franka_emika_panda`
(Apache-2.0). Contacts have boxes of published dimensions, those of a finger by the manufacturer's
robot description (Apache-2.0). In the hand's frame z points out of the flange, and the fingers open
along y.
"""

import math

import mujoco

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.world.objects.shapes import Colour, hull
from duobench.world.objects.solid import manifold_of, mesh_of
from duobench.world.robot.fr3_links import WHITE, Link
from duobench.world.robot.gripper import Gripper
from duobench.world.scene.fingers import add_motor, add_pad
from duobench.world.scene.meshes import FLAT, add_link, add_mesh, add_visual_mesh
from duobench.world.scene.naming import gripper_name
from duobench.world.scene.surfaces import (
    COLLISION_GEOM_GROUP,
    CONTACT_SOLIMP,
    CONTACT_SOLREF,
    DISTAL,
    add_box,
    collide_unseen,
    visual_only,
)

SERVO_BAND = 0.002
"""Error of the gap in metres from which on the full force acts."""
ARMATURE = 0.15
"""Inertia of motor and belt in kg, as one finger moves it (estimated)."""
_METAL = (0.70, 0.71, 0.72, 1.0)
_RUBBER = (0.15, 0.15, 0.15, 1.0)

_PALM = (
    *((x, y, 0.0) for x in (-0.013, 0.013) for y in (-0.0315, 0.0315)),
    *((x, y, 0.0) for x in (-0.0315, 0.0315) for y in (-0.013, 0.013)),
    *((x, y, 0.012) for x in (-0.0315, 0.0315) for y in (-0.045, 0.045)),
    *(
        (x, y, z)
        for x in (-0.0315, 0.0315)
        for y in (-0.09, 0.09)
        for z in (0.03, 0.058)
    ),
    *((x, y, z) for x in (-0.02, 0.02) for y in (-0.102, 0.102) for z in (0.03, 0.058)),
    *((x, y, 0.0659) for x in (-0.0245, 0.0245) for y in (-0.092, 0.092)),
)
"""Corners of the hand's convex body in metres: 204 mm wide, 63 mm deep [data sheet]."""
_BASE = Link(
    mass=0.73,
    centre=(-0.01, 0.0, 0.03),
    axes_wxyz=(1.0, 0.0, 0.0, 0.0),
    inertia=(0.001, 0.0025, 0.0017),
)
_FINGER = Link(
    mass=0.0115,
    centre=(0.0, 0.0, 0.0),
    axes_wxyz=(1.0, 0.0, 0.0, 0.0),
    inertia=(2.375e-6, 2.375e-6, 7.5e-7),
)
FINGER_Z = 0.0584
"""Height of the fingers' frames in the hand's, in metres."""
_BOXES = (
    (SE3.at(0.0, 0.0185, 0.011), (0.022, 0.015, 0.020)),
    (SE3.at(0.0, 0.0068, 0.0022), (0.022, 0.0088, 0.0038)),
    (
        SE3.at(0.0, 0.0159, 0.02835) @ SE3.about((1.0, 0.0, 0.0), math.pi / 6),
        (0.0175, 0.007, 0.0235),
    ),
    (SE3.at(0.0, 0.00959, 0.04475), (0.0175, 0.01118, 0.0175)),
)
"""Pose and lengths in metres of the boxes of a finger: mount, slide, slope, and what is behind the
rubber tip."""
TIP_SIZE = (0.00875, 0.002, 0.004375)
"""Half sizes of one of the two boxes of a rubber tip, in metres."""
TIPS = (0.040375, 0.049125)
"""Heights in the finger's frame of their middles, in metres."""
_TIP_MASS = 0.00175


def add_gripper(
    spec: mujoco.MjSpec,
    gripper: Gripper,
    side: Side,
    body: mujoco.MjsBody,
    flange: SE3,
) -> None:
    """Hang a hand with its fingers and its actuator on the flange of a body."""
    prefix = gripper_name(side)
    base = add_link(body, f"{prefix}/base", _BASE)
    pose = flange @ gripper.flange_from_base
    base.pos, base.quat = pose.translation, pose.wxyz
    name = "franka_hand/palm"
    if spec.mesh(name) is None:
        add_visual_mesh(spec, name, mesh_of(manifold_of(hull(_PALM))), crease=FLAT)
    _add_image(spec, base, "hand", WHITE)
    palm = base.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
    collide_unseen(palm, DISTAL[side])
    for finger, turn in zip(gripper.fingers, (math.pi, 0.0), strict=True):
        _add_finger(spec, gripper, side, finger, SE3.at(z=FINGER_Z, yaw=turn), base)
    force = gripper.force
    add_motor(
        spec,
        gripper,
        side,
        share=1.0,
        force=force,
        damping=force / gripper.speeds[1],
        band=SERVO_BAND,
    )


def _add_image(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, rgba: Colour
) -> None:
    image = add_mesh(spec, body, f"franka_hand/{name}:visual")
    image.rgba = rgba
    visual_only(image)


def _add_finger(
    spec: mujoco.MjSpec,
    gripper: Gripper,
    side: Side,
    finger: str,
    closed: SE3,
    base: mujoco.MjsBody,
) -> None:
    """Add a finger, whose frame has a pose in the base's when it is closed."""
    prefix = f"{gripper_name(side)}/{finger}"
    pose = closed @ SE3.at(y=gripper.stroke / 2)
    body = add_link(base, f"{prefix}_finger", _FINGER)
    body.pos, body.quat = pose.translation, pose.wxyz
    body.add_joint(
        name=f"{prefix}_{gripper.drive}",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=(0, -1, 0),
        range=(0.0, gripper.drive_closed + 0.002),
        limited=True,
        armature=ARMATURE,
        solref_limit=CONTACT_SOLREF,
        solimp_limit=CONTACT_SOLIMP,
    )
    _add_image(spec, body, "finger", _METAL)
    _add_image(spec, body, "tip", _RUBBER)
    for at, size in _BOXES:
        collide_unseen(add_box(body, at, size, _METAL), DISTAL[side])
    tip = body.add_body(name=f"{prefix}_{gripper.pad}", gravcomp=1.0)
    for height in TIPS:
        at = (0.0, TIP_SIZE[1], height)
        box = add_pad(tip, side, TIP_SIZE, at, _TIP_MASS, _RUBBER)
        box.group = COLLISION_GEOM_GROUP
