"""The FR3 Duo: two arms of the published numbers of `robot.fr3_links`, grippers and cameras."""

import mujoco

from duobench.core.references import load
from duobench.core.types import ARM_JOINTS, SIDES, Side
from duobench.world.robot.fr3_links import LINKS, WHITE, Joint
from duobench.world.robot.frames import (
    Robot,
)
from duobench.world.scene.cameras import add_cameras
from duobench.world.scene.meshes import add_link, add_mesh
from duobench.world.scene.naming import arm_joint_names, flange_name, tcp_name
from duobench.world.scene.surfaces import (
    DISTAL,
    PROXIMAL,
    collide_unseen,
    visual_only,
)

JOINT_DAMPING = 0.21
"""Viscous damping of every joint in N·m·s/rad [Menagerie franka_fr3]."""

_FIRST_DISTAL_LINK = 6
_STOPPERS = ("link3_1", "link4_1", "link5_2", "link6_6")
"""Trim that closes an opening of a white shell, and casts a shadow as the shells do: light would
fall in. All other trim lies on the shells."""


def add_robot(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add both arms with grippers and wrist cameras to a model under construction."""
    add_gripper = load(robot.gripper.model, "model of a gripper", callable)
    for side in SIDES:
        bodies = _add_kinematics(spec, side, robot)
        _add_geometry(spec, side, bodies)
        add_gripper(spec, robot.gripper, side, bodies[-1], robot.link7_from_flange)
        add_cameras(bodies[-1], robot.gripper, side, robot.link7_from_flange)


def kinematic_model(side: Side, robot: Robot) -> mujoco.MjModel:
    """One arm alone: 7 joints, flange and tool sites, no geometry, no gripper.

    Inverse kinematics solves on this model, so its cost does not grow with the scene.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    _add_kinematics(spec, side, robot)
    return spec.compile()


def _add_kinematics(
    spec: mujoco.MjSpec, side: Side, robot: Robot
) -> list[mujoco.MjsBody]:
    """Add bodies, joints, servos and sites of one arm, no geometry; return link 0 to link 7."""
    bodies: list[mujoco.MjsBody] = []
    for number, link in enumerate(LINKS):
        parent = bodies[-1] if bodies else spec.worldbody
        bodies.append(add_link(parent, f"{side}/link{number}", link))
        if link.joint is not None:
            _add_joint(spec, bodies[-1], arm_joint_names(side)[number - 1], link.joint)
    base = robot.mount.bases[side]
    bodies[0].pos, bodies[0].quat = base.translation, base.wxyz
    for name, pose in (
        (flange_name(side), robot.link7_from_flange),
        (tcp_name(side), robot.link7_from_tcp),
    ):
        bodies[-1].add_site(
            name=name,
            pos=pose.translation,
            quat=pose.wxyz,
            size=[0.001] * 3,
            group=4,
        )
    return bodies


def _add_joint(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, joint: Joint
) -> None:
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


def _add_geometry(
    spec: mujoco.MjSpec, side: Side, bodies: list[mujoco.MjsBody]
) -> None:
    for number, (link, body) in enumerate(zip(LINKS, bodies, strict=True)):
        for name, rgba in link.visuals:
            image = add_mesh(spec, body, f"fr3/{name}:visual")
            image.rgba = rgba
            visual_only(image, shadow=rgba == WHITE or name in _STOPPERS)
        hull = add_mesh(spec, body, f"fr3/link{number}:hull")
        hull.name = f"{side}/link{number}_hull"
        collide_unseen(
            hull, DISTAL[side] if number >= _FIRST_DISTAL_LINK else PROXIMAL[side]
        )
    # The forearm and the wrist two joints on share space by design; the range of joint 6 keeps
    # them apart.
    spec.add_exclude(bodyname1=f"{side}/link5", bodyname2=f"{side}/link{ARM_JOINTS}")
