"""What fingers of all grippers here have alike: the motor that drives them, and rubber pads."""

import mujoco

from duobench.core.types import Side
from duobench.world.objects.shapes import Colour
from duobench.world.robot.fr3_links import Vector
from duobench.world.robot.gripper import Gripper
from duobench.world.scene.naming import drive_names, gripper_name
from duobench.world.scene.surfaces import (
    CONTACT_SOLIMP,
    CONTACT_SOLREF,
    DISTAL,
    ROLLING,
    TORSION,
    collide_as,
)

PAD_SOLREF = (0.004, 1.0)
"""Contact time constant of the pads [facts of the platform]; MuJoCo raises it to two time steps."""
PAD_FRICTION = 0.8
"""Sliding friction of the rubber pads on plastic."""


def add_motor(
    spec: mujoco.MjSpec,
    gripper: Gripper,
    side: Side,
    *,
    share: float,
    force: float,
    damping: float,
    band: float,
) -> None:
    """Couple the two drives of a gripper, and drive both through one tendon.

    The motor moves the fingers at a set speed until they meet something, and then presses with a
    set force, at every commanded opening. As a torque-speed line: `force` at standstill, none left
    at the set speed. The position servo only brings it to a halt at the commanded opening.

    Args:
        spec: The model under construction.
        gripper: The gripper.
        side: Its arm.
        share: Share of the tendon's force on each drive.
        force: Force of the actuator at standstill, in the tendon's units.
        damping: Damping of the tendon that gives the set speed.
        band: Error of the tendon's length from which on the full force acts.
    """
    prefix = gripper_name(side)
    first, second = drive_names(side, gripper)
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=second,
        name2=first,
        data=[0.0, 1.0, *[0.0] * 10],
        solref=CONTACT_SOLREF,
        solimp=CONTACT_SOLIMP,
    )
    tendon = spec.add_tendon(name=prefix, damping=[damping, 0.0, 0.0])
    for joint in (first, second):
        tendon.wrap_joint(joint, share)
    closed = gripper.drive_closed * (2 * share)
    stiffness = force / band
    spec.add_actuator(
        name=prefix,
        target=prefix,
        trntype=mujoco.mjtTrn.mjTRN_TENDON,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        gainprm=[stiffness * closed / gripper.ctrl_closed, *[0.0] * 9],
        biasprm=[0.0, -stiffness, *[0.0] * 8],
        ctrlrange=(0.0, gripper.ctrl_closed),
        ctrllimited=True,
        forcerange=(-force, force),
        forcelimited=True,
    )


def add_pad(
    body: mujoco.MjsBody,
    side: Side,
    size: Vector,
    position: Vector,
    mass: float,
    rgba: Colour,
) -> mujoco.MjsGeom:
    """Add a box of rubber to a finger, by its half sizes and its middle in metres."""
    pad = body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=size,
        pos=position,
        mass=mass,
        friction=(PAD_FRICTION, TORSION, ROLLING),
        solref=PAD_SOLREF,
        solimp=CONTACT_SOLIMP,
        priority=1,
        rgba=rgba,
    )
    collide_as(pad, DISTAL[side])
    return pad
