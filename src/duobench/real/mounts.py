"""Detection of swapped arms by the torques that gravity causes.

Each arm is mounted tilted to its own side, so that gravity loads the joints of the left arm and of
the right arm differently. Arms whose cables or addresses are swapped measure the torques of the
other mount. Not tried on an arm.
"""

from collections.abc import Mapping

import numpy as np

from duobench.core.types import SIDES, Array, Side
from duobench.real.devices import ArmReading
from duobench.world.robot.frames import Robot

MIN_TORQUE = 3.0
"""Torque of an arm in N·m (norm over its joints) below which nothing is concluded."""
MAX_RATIO = 0.5
"""Arms are swapped if the misfit with the other mount is at most this share of that with their
own mount."""
SWAPPED = "The arms are swapped: exchange their addresses in the rig's file, or cables."


def gravity_torques(joints: Array, robot: Robot) -> Array:
    """Simulated torques (2, 7) in N·m that hold the arms, grippers and cameras against gravity.

    Args:
        joints: Joint positions (2, 7) in radians.
        robot: Description of the arms.
    """
    import mujoco

    from duobench.world.sim.simulation import Simulation

    sim = Simulation(robot=robot)
    places = np.asarray(sim.duo.joints)
    sim.data.qpos[places] = joints
    sim.data.qvel[:] = 0.0
    mujoco.mj_forward(sim.model, sim.data)
    dofs = sim.model.jnt_dofadr[np.searchsorted(sim.model.jnt_qposadr, places)]
    return sim.data.qfrc_bias[dofs]


def misfits(
    readings: Mapping[Side, ArmReading], robot: Robot
) -> tuple[Array, Array] | None:
    """Misfits (2,) in N·m of both arms' measured torques with their own mounts, and swapped.

    None if the arms measure hardly any torques, as simulated ones do.
    """
    joints = np.array([readings[side].joints for side in SIDES])
    felt = np.array([readings[side].torques for side in SIDES])
    if np.linalg.norm(felt, axis=-1).min() < MIN_TORQUE:
        return None
    own = np.linalg.norm(felt - gravity_torques(joints, robot), axis=-1)
    # The same joints in the other arm's mount.
    other = np.linalg.norm(felt - gravity_torques(joints[::-1], robot)[::-1], axis=-1)
    return own, other


def are_swapped(readings: Mapping[Side, ArmReading], robot: Robot) -> bool:
    """Whether both arms measure the torques of the other arm's mount."""
    found = misfits(readings, robot)
    if found is None:
        return False
    own, other = found
    return bool(np.all(other <= MAX_RATIO * own))
