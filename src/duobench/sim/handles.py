"""Names to ids, once, when a simulation is built; a misspelt name fails here."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.errors import DuoBenchError, UnknownNameError
from duobench.scene.naming import (
    arm_joint_names,
    gripper_name,
    tcp_name,
)
from duobench.types import SIDES

Ids = NDArray[np.int64]

_KINDS = {
    mujoco.mjtObj.mjOBJ_BODY: ("body", "nbody"),
    mujoco.mjtObj.mjOBJ_JOINT: ("joint", "njnt"),
    mujoco.mjtObj.mjOBJ_GEOM: ("geom", "ngeom"),
    mujoco.mjtObj.mjOBJ_SITE: ("site", "nsite"),
    mujoco.mjtObj.mjOBJ_ACTUATOR: ("actuator", "nu"),
    mujoco.mjtObj.mjOBJ_CAMERA: ("camera", "ncam"),
}


def names_of(model: mujoco.MjModel, kind: mujoco.mjtObj) -> list[str]:
    """Every non-empty name of one kind, in the model's order."""
    count = getattr(model, _KINDS[kind][1])
    names = (mujoco.mj_id2name(model, kind, number) for number in range(count))
    return [name for name in names if name]


def resolve(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> int:
    """Id of a named element.

    Raises:
        UnknownNameError: No element of that kind has the name; near misses are listed.
    """
    number = mujoco.mj_name2id(model, kind, name)
    if number < 0:
        raise UnknownNameError(_KINDS[kind][0], name, names_of(model, kind))
    return number


def resolve_all(model: mujoco.MjModel, kind: mujoco.mjtObj, names: Iterable[str]) -> Ids:
    """Ids of several named elements, in the order given."""
    return np.array([resolve(model, kind, name) for name in names], dtype=np.int64)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DuoHandles:
    """Where the two arms live in the model's arrays; rows are left, right."""

    joints: Ids
    """Arm joint ids (2, 7)."""
    qpos: Ids
    """Addresses of the arm joints in qpos (2, 7)."""
    dofs: Ids
    """Addresses of the arm joints in qvel (2, 7)."""
    drivers: Ids
    """Addresses of the gripper driver joints in qpos (2, 2)."""
    tcp_sites: Ids
    """Ids of the tool sites (2,)."""
    actuators: slice
    """Where the actuators are in ctrl: 16 in a row, in the order of a flat command."""

    @staticmethod
    def of(model: mujoco.MjModel) -> DuoHandles:
        """Resolve every name of the robot in a model."""
        joint, actuator = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_ACTUATOR
        joints = np.array([resolve_all(model, joint, arm_joint_names(s)) for s in SIDES])
        drivers = [
            resolve_all(model, joint, [f"{gripper_name(s)}/{f}_driver" for f in ("left", "right")])
            for s in SIDES
        ]
        names = [name for s in SIDES for name in (*arm_joint_names(s), gripper_name(s))]
        first = resolve(model, actuator, names[0])
        actuators = slice(first, first + len(names))
        if names_of(model, actuator)[actuators] != names:
            raise DuoBenchError(
                f"The robot's actuators must follow each other in the order {', '.join(names)}; "
                f"the model has {', '.join(names_of(model, actuator))}."
            )
        return DuoHandles(
            joints=joints,
            qpos=model.jnt_qposadr[joints].astype(np.int64),
            dofs=model.jnt_dofadr[joints].astype(np.int64),
            drivers=model.jnt_qposadr[np.array(drivers)].astype(np.int64),
            tcp_sites=resolve_all(model, mujoco.mjtObj.mjOBJ_SITE, [tcp_name(s) for s in SIDES]),
            actuators=actuators,
        )
