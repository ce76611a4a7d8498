"""Left and right, told by gravity: both arms hang tilted to their own side.

So gravity pulls other joints of the left arm than of the right one, and arms whose cables or
addresses are swapped feel the torques of the other mount. Not tried on an arm.
"""

from collections.abc import Mapping

import numpy as np

from duobench.core.types import SIDES, Array, Side
from duobench.real.devices import ArmReading

SMALLEST = 3.0
"""Torques in N·m that have to be felt, and to differ between the mounts, for an answer."""
CLEAR = 0.5
"""An arm is of the mount whose torques differ by this share of the other's at most."""
SWAPPED = "The arms are swapped: exchange their addresses in the rig's file, or cables."


def gravity_torques(joints: Array) -> Array:
    """Torques (2, 7) in N·m with which the arms carry themselves, grippers and cameras.

    They are those of our own simulation at joints (2, 7) in radians.
    """
    import mujoco

    from duobench.world.sim.simulation import Simulation

    sim = Simulation()
    places = np.asarray(sim.duo.joints)
    sim.data.qpos[places] = joints
    sim.data.qvel[:] = 0.0
    mujoco.mj_forward(sim.model, sim.data)
    dofs = sim.model.jnt_dofadr[np.searchsorted(sim.model.jnt_qposadr, places)]
    return sim.data.qfrc_bias[dofs]


def misfits(readings: Mapping[Side, ArmReading]) -> tuple[Array, Array] | None:
    """How far in N·m each arm's torques (2,) at rest are from those of its mount and of the other.

    None where the arms feel no torques, as computed ones.
    """
    joints = np.array([readings[side].joints for side in SIDES])
    felt = np.array([readings[side].torques for side in SIDES])
    if np.linalg.norm(felt, axis=-1).min() < SMALLEST:
        return None
    own = np.linalg.norm(felt - gravity_torques(joints), axis=-1)
    # The same joints in the other arm's mount.
    other = np.linalg.norm(felt - gravity_torques(joints[::-1])[::-1], axis=-1)
    return own, other


def are_swapped(readings: Mapping[Side, ArmReading]) -> bool:
    """Whether both arms feel what the other's mount would make them feel."""
    found = misfits(readings)
    return found is not None and bool(np.all(found[1] <= CLEAR * found[0]))
