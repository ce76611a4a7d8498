"""One Franka Research 3 arm, built from published numbers.

Kinematics, inertias, armature and friction are those of MuJoCo Menagerie's `franka_fr3`
(Apache-2.0); joint ranges and velocity limits are the manufacturer's data sheet; servo gains are
the ones that Menagerie publishes for position control.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from duobench.scene.filters import COLLISION_GEOM_GROUP, collide_as, distal, proximal, visual_only
from duobench.scene.meshes import add_robot_mesh
from duobench.scene.naming import arm_joint_names, flange_name
from duobench.scene.surfaces import set_metal
from duobench.spatial import SE3
from duobench.types import ARM_JOINTS, Side

FLANGE_OFFSET = 0.107
"""Flange beyond link 7 along its z, in metres [Menagerie franka_fr3]."""
VELOCITY_LIMITS = (2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26)
"""Joint velocity limits in rad/s [Franka data sheet]."""
JOINT_DAMPING = 0.21
"""Viscous damping of every joint in N·m·s/rad [Menagerie franka_fr3]."""

BASE_POSES = {
    Side.LEFT: SE3.from_wxyz((0.865641, -0.436978, 0.0225312, -0.243326), (0.0, 0.05018, 0.342)),
    Side.RIGHT: SE3.from_wxyz((0.865641, 0.436978, 0.0225312, 0.243326), (0.0, -0.05018, 0.342)),
}
"""World from arm base [manufacturer's duo set-up, as used by Robot Control Stack]."""
_SHOULDER_HEIGHT = 0.333
"""Where the axes of joints 1 to 3 meet above the base, in metres [Menagerie franka_fr3]."""
SHOULDERS = {side: base.apply((0.0, 0.0, _SHOULDER_HEIGHT)) for side, base in BASE_POSES.items()}
"""Middle of each arm's shoulder (3,) in the table frame."""

_LEFT_HOME = (
    0.48797692,
    -0.57224476,
    -0.58536988,
    -2.57958827,
    0.86400183,
    2.0530809,
    -0.85965005,
)
HOME_JOINTS = np.array([_LEFT_HOME, np.multiply(_LEFT_HOME, (-1, 1, -1, 1, -1, 1, -1))])
"""Home configuration (2, 7) in radians; the right arm mirrors the left."""
HOME_JOINTS.setflags(write=False)

BLACK = (0.2, 0.2, 0.2, 1.0)
WHITE = (1.0, 1.0, 1.0, 1.0)
RED = (1.0, 0.072272, 0.039546, 1.0)

Vector = tuple[float, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Inertial:
    """Mass properties of a body in its own frame."""

    mass: float
    position: Vector
    wxyz: Vector
    diagonal: Vector


@dataclass(frozen=True, kw_only=True, slots=True)
class Joint:
    """A revolute joint about its body's z axis, with its position servo."""

    limits: tuple[float, float]
    torque: float
    armature: float
    friction: float
    kp: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Link:
    """One link: where it hangs on the one before it, and what it looks like."""

    position: Vector = (0.0, 0.0, 0.0)
    wxyz: Vector = (1.0, 0.0, 0.0, 0.0)
    inertial: Inertial | None = None
    joint: Joint | None = None
    visuals: tuple[tuple[str, Vector], ...]


# The published model has eleven more images: buttons, plugs and lettering, less than a pixel in
# any camera. `tools/meshes` leaves them out.
LINKS = (
    Link(
        visuals=(
            ("link0_3", WHITE),
            ("link0_5", RED),
            ("link0_6", BLACK),
        ),
    ),
    Link(
        position=(0.0, 0.0, 0.333),
        inertial=Inertial(
            mass=2.92747,
            position=(4.128e-07, -0.0181251, -0.0386036),
            wxyz=(0.998098, -0.0605364, 0.00380499, 0.0110109),
            diagonal=(0.0239286, 0.0227246, 0.00610634),
        ),
        joint=Joint(limits=(-2.7437, 2.7437), torque=87, armature=0.195, friction=1.137, kp=4500),
        visuals=(("link1", WHITE),),
    ),
    Link(
        wxyz=(1.0, -1.0, 0.0, 0.0),
        inertial=Inertial(
            mass=2.93554,
            position=(0.00318289, -0.0743222, 0.00881461),
            wxyz=(0.502599, 0.584437, -0.465998, 0.434366),
            diagonal=(0.0629567, 0.0411924, 0.0246371),
        ),
        joint=Joint(limits=(-1.7837, 1.7837), torque=87, armature=0.195, friction=1.137, kp=4500),
        visuals=(("link2", WHITE),),
    ),
    Link(
        position=(0.0, -0.316, 0.0),
        wxyz=(1.0, 1.0, 0.0, 0.0),
        inertial=Inertial(
            mass=2.2449,
            position=(0.0407016, -0.00482006, -0.0289731),
            wxyz=(0.921025, -0.244161, 0.155272, 0.260745),
            diagonal=(0.0267409, 0.0189869, 0.0171587),
        ),
        joint=Joint(limits=(-2.9007, 2.9007), torque=87, armature=0.195, friction=1.137, kp=3500),
        visuals=(("link3_0", WHITE), ("link3_1", BLACK)),
    ),
    Link(
        position=(0.0825, 0.0, 0.0),
        wxyz=(1.0, 1.0, 0.0, 0.0),
        inertial=Inertial(
            mass=2.6156,
            position=(-0.0459101, 0.0630493, -0.00851879),
            wxyz=(0.438018, 0.803311, 0.00937812, 0.403414),
            diagonal=(0.05139, 0.0372717, 0.0160047),
        ),
        joint=Joint(limits=(-3.0421, -0.1518), torque=87, armature=0.195, friction=1.137, kp=3500),
        visuals=(("link4_0", WHITE), ("link4_1", BLACK)),
    ),
    Link(
        position=(-0.0825, 0.384, 0.0),
        wxyz=(1.0, -1.0, 0.0, 0.0),
        inertial=Inertial(
            mass=2.32712,
            position=(-0.00160396, 0.0292536, -0.0972966),
            wxyz=(0.919031, 0.125604, 0.0751531, -0.366003),
            diagonal=(0.0579335, 0.0449144, 0.0130634),
        ),
        joint=Joint(limits=(-2.8065, 2.8065), torque=12, armature=0.074, friction=0.763, kp=2000),
        visuals=(("link5_0", WHITE), ("link5_2", BLACK)),
    ),
    Link(
        wxyz=(1.0, 1.0, 0.0, 0.0),
        inertial=Inertial(
            mass=1.81704,
            position=(0.0597131, -0.0410295, -0.0101693),
            wxyz=(0.621301, 0.552665, 0.510011, 0.220081),
            diagonal=(0.0175039, 0.0161123, 0.00193529),
        ),
        joint=Joint(limits=(0.5445, 4.5169), torque=12, armature=0.074, friction=0.44, kp=2000),
        visuals=(
            ("link6_1", WHITE),
            ("link6_2", WHITE),
            ("link6_6", BLACK),
        ),
    ),
    Link(
        position=(0.088, 0.0, 0.0),
        wxyz=(1.0, 1.0, 0.0, 0.0),
        inertial=Inertial(
            mass=0.627143,
            position=(0.00452258, 0.00862619, -0.0161633),
            wxyz=(0.727579, 0.0978688, -0.24906, 0.63168),
            diagonal=(0.000223836, 0.000223642, 5.64132e-07),
        ),
        joint=Joint(limits=(-3.0159, 3.0159), torque=12, armature=0.074, friction=0.248, kp=2000),
        visuals=(
            ("link7_1", WHITE),
            ("link7_2", WHITE),
            ("link7_3", BLACK),
        ),
    ),
)
"""Link 0 (the base) to link 7."""

JOINT_RANGES = np.array([link.joint.limits for link in LINKS if link.joint is not None])
"""Joint ranges (7, 2) in radians."""
JOINT_RANGES.setflags(write=False)

_FIRST_DISTAL_LINK = 6
_LAST_LINK = len(LINKS) - 1


def add_kinematics(spec: mujoco.MjSpec, side: Side) -> list[mujoco.MjsBody]:
    """Add the bodies, joints, servos and the flange site of one arm, without any geometry.

    Args:
        spec: The model under construction; the arm hangs on its world body.
        side: Which arm; its names start with the side.

    Returns:
        The bodies of link 0 to link 7.
    """
    bodies: list[mujoco.MjsBody] = []
    parent = spec.worldbody
    names = arm_joint_names(side)
    for number, link in enumerate(LINKS):
        body = parent.add_body(name=f"{side}/link{number}", gravcomp=1.0)
        if number == 0:
            body.pos, body.quat = BASE_POSES[side].translation, BASE_POSES[side].wxyz
        else:
            body.pos, body.quat = link.position, link.wxyz
        if link.inertial is not None:
            body.explicitinertial = True
            body.mass = link.inertial.mass
            body.ipos, body.iquat = link.inertial.position, link.inertial.wxyz
            body.inertia = link.inertial.diagonal
        if link.joint is not None:
            _add_joint(spec, body, names[number - 1], link.joint)
        bodies.append(body)
        parent = body
    bodies[_LAST_LINK].add_site(
        name=flange_name(side), pos=(0, 0, FLANGE_OFFSET), size=[0.001] * 3, group=4
    )
    return bodies


def _add_joint(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, joint: Joint) -> None:
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=(0, 0, 1),
        range=joint.limits,
        limited=True,
        damping=[JOINT_DAMPING, 0, 0],
        armature=joint.armature,
        frictionloss=joint.friction,
    )
    servo = spec.add_actuator(
        name=name,
        target=name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        ctrlrange=joint.limits,
        ctrllimited=True,
        forcerange=(-joint.torque, joint.torque),
        forcelimited=True,
    )
    servo.set_to_position(kp=joint.kp, kv=joint.kp / 10)


_STOPPERS = ("link3_1", "link4_1", "link5_2", "link6_6")
"""Trim that closes an opening of a white shell, and casts a shadow as the shells do: light would
fall in. All other trim lies on the shells."""


def add_geometry(spec: mujoco.MjSpec, side: Side, bodies: list[mujoco.MjsBody]) -> None:
    """Add the images and the collision hulls of one arm to its bodies."""
    for number, (link, body) in enumerate(zip(LINKS, bodies, strict=True)):
        for name, rgba in link.visuals:
            geom = body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=add_robot_mesh(spec, f"fr3/{name}:visual"),
                rgba=rgba,
            )
            visual_only(geom, shadow=rgba == WHITE or name in _STOPPERS)
        hull = body.add_geom(
            name=f"{side}/link{number}_hull",
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=add_robot_mesh(spec, f"fr3/link{number}:hull"),
            density=0.0,
            group=COLLISION_GEOM_GROUP,
        )
        collide_as(hull, distal(side) if number >= _FIRST_DISTAL_LINK else proximal(side))
        set_metal(hull)
    # The forearm and the wrist two joints on share space by design; the range of joint 6 keeps
    # them apart.
    spec.add_exclude(bodyname1=f"{side}/link5", bodyname2=f"{side}/link{ARM_JOINTS}")
