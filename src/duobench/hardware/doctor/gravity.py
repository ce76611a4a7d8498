"""Whether the arms are the ones that the rig says: their torques at rest tell how they are mounted.

Both arms of the duo hang tilted to their own side, so that gravity pulls other joints of the left
arm than of the right one. The torques that gravity asks for are those of our own simulation. Not
tried on an arm.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from duobench.hardware.devices import ArmReading
from duobench.hardware.doctor.checks import Check, Outcome
from duobench.types import SIDES, Array, Side

SMALLEST = 3.0
"""Torques in N·m that have to be felt, and to differ between the mounts, for an answer."""
CLEAR = 0.5
"""An arm is of the mount whose torques differ by this share of the other's at most."""


def gravity_torques(joints: Array) -> Array:
    """Torques with which the arms carry themselves, their grippers and cameras.

    Args:
        joints: Joint positions (2, 7) in radians.

    Returns:
        Torques (2, 7) in N·m. MuJoCo is loaded here.
    """
    import mujoco

    from duobench.sim.simulation import Simulation

    sim = Simulation()
    places = np.asarray(sim.duo.joints)
    sim.data.qpos[places] = joints
    sim.data.qvel[:] = 0.0
    mujoco.mj_forward(sim.model, sim.data)
    dof_of = dict(zip(sim.model.jnt_qposadr.tolist(), sim.model.jnt_dofadr.tolist(), strict=True))
    dofs = np.array([[dof_of[place] for place in row] for row in places.tolist()])
    return sim.data.qfrc_bias[dofs]


def mount_check(readings: Mapping[Side, ArmReading]) -> Check:
    """Say whether left and right are swapped.

    Args:
        readings: Both arms at rest.
    """
    name = "left and right arm"
    joints = np.array([readings[side].joints for side in SIDES])
    felt = np.array([readings[side].torques for side in SIDES])
    if np.linalg.norm(felt, axis=-1).min() < SMALLEST:
        return Check(name=name, outcome=Outcome.SKIPPED, value="the arms feel no torques")
    own = np.linalg.norm(felt - gravity_torques(joints), axis=-1)
    # The same joints in the other arm's mount.
    other = np.linalg.norm(felt - gravity_torques(joints[::-1])[::-1], axis=-1)
    value = ", ".join(
        f"{side}: {own[side.index]:.1f} N·m off as {side}, {other[side.index]:.1f} as {side.other}"
        for side in SIDES
    )
    if np.all(own <= CLEAR * other):
        return Check(name=name, outcome=Outcome.OK, value=value)
    if np.all(other <= CLEAR * own):
        return Check(
            name=name,
            outcome=Outcome.FAILED,
            value=value,
            advice="The arms are swapped: exchange their addresses in the rig's file, or cables.",
        )
    return Check(
        name=name,
        outcome=Outcome.NOTE,
        value=value,
        advice="Torques fit neither mount well: look at the mass of the tool that the control box "
        "knows, and at whether something touches an arm.",
    )
