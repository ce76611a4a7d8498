"""The two arms in simulation: commands in, state out; and names to ids, once, when it is built."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from duobench.core.backend import DuoLimits
from duobench.core.errors import DuoBenchError, UnknownNameError
from duobench.core.types import (
    OPENING_SLOTS,
    SIDES,
    Array,
    DuoCommand,
    DuoState,
)
from duobench.world.robot.frames import Robot
from duobench.world.robot.joints import SERVO_LAG, duo_limits
from duobench.world.scene.compose import SUBSTEPS
from duobench.world.scene.naming import (
    arm_joint_names,
    drive_names,
    gripper_name,
    tcp_name,
)

_KINDS = {
    mujoco.mjtObj.mjOBJ_BODY: ("body", "nbody"),
    mujoco.mjtObj.mjOBJ_JOINT: ("joint", "njnt"),
    mujoco.mjtObj.mjOBJ_SITE: ("site", "nsite"),
    mujoco.mjtObj.mjOBJ_ACTUATOR: ("actuator", "nu"),
}


def names_of(model: mujoco.MjModel, kind: mujoco.mjtObj) -> list[str]:
    """Every non-empty name of one kind, in the model's order."""
    count = getattr(model, _KINDS[kind][1])
    names = (mujoco.mj_id2name(model, kind, number) for number in range(count))
    return [name for name in names if name]


def resolve(
    model: mujoco.MjModel,
    kind: mujoco.mjtObj,
    name: str,
) -> int:
    """Id of a named element."""
    number = mujoco.mj_name2id(model, kind, name)
    if number < 0:
        raise UnknownNameError(_KINDS[kind][0], name, names_of(model, kind))
    return number


_OPENINGS = np.array(OPENING_SLOTS)
_FRACTIONS = (np.arange(1, SUBSTEPS + 1) / SUBSTEPS)[:, None]


class Duo:
    """Translates between flat commands and the engine's arrays of one model."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, robot: Robot
    ) -> None:
        self.robot = robot
        """Description of the arms."""
        self._closed_by_drives = 0.5 / robot.gripper.drive_closed
        joint, site = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_SITE
        joints = [
            [resolve(model, joint, name) for name in arm_joint_names(s)] for s in SIDES
        ]
        drives = [
            resolve(model, joint, name)
            for s in SIDES
            for name in drive_names(s, robot.gripper)
        ]
        self.joints = model.jnt_qposadr[joints].astype(np.int64)
        """Addresses of the arm joints in qpos (2, 7)."""
        self.dofs = model.jnt_dofadr[joints].astype(np.int64)
        """Addresses of the arm joints in qvel (2, 7)."""
        self.drivers = model.jnt_qposadr[drives].astype(np.int64)
        """Addresses of the fingers' joints in qpos (4,), two a gripper."""
        self.sites = [resolve(model, site, tcp_name(side)) for side in SIDES]
        self._data = data
        # Views of the engine's memory; they live as long as its data.
        self.actuators = _actuators(model)
        """Slice of the robot's actuators in ctrl."""
        self._qpos, self._ctrl = data.qpos, data.ctrl[self.actuators]
        self._site_xpos, self._site_xmat = data.site_xpos, data.site_xmat
        self._quat = np.empty(4)
        self.limits = duo_limits(lag=SERVO_LAG)
        """Limits of the arms."""

    def clipped(self, targets: Array, limits: DuoLimits | None = None) -> Array:
        """The command nearest to some targets (16,) within limits, the arms' own at first."""
        last, measured = self.command().flat, self.read().flat
        return (limits or self.limits).clip(
            targets, last, measured, self.joint_velocities()
        )

    def interpolate(self, command: DuoCommand) -> Iterator[None]:
        """Lead the controls linearly from where they are to a command.

        Yields:
            Once for each of the substeps, when its controls are in place. The last ones are
            exactly the command's, so that it can be read back and repeated.
        """
        for row in ramp(self._ctrl, self.controls_of(command.flat)):
            self._ctrl[:] = row
            yield

    def set_configuration(self, command: DuoCommand) -> None:
        """Put the arms at a command without moving there: positions, controls, linkages open.

        The linkages of the grippers are at rest at opening 1, the only one that this accepts.
        """
        if not np.all(command.openings == 1.0):
            raise ValueError("The arms can be placed with open grippers only.")
        self._qpos[self.joints] = command.joints
        self._ctrl[:] = self.controls_of(command.flat)

    def command(self) -> DuoCommand:
        """The last command, as the actuators hold it."""
        return DuoCommand.from_flat(self.commands_of(self._ctrl))

    def read(self) -> DuoState:
        """Joint positions, openings and tool poses, as of the last physics step."""
        tools = []
        for site in self.sites:
            mujoco.mju_mat2Quat(self._quat, self._site_xmat[site])
            w, x, y, z = self._quat.tolist()
            # Of the two equal quaternions the one with qx >= 0: it does not flip its sign while
            # a tool points down, at every yaw.
            tools += self._site_xpos[site].tolist()
            tools += [-x, -y, -z, -w] if x < 0.0 else [x, y, z, w]
        left, other_left, right, other_right = self._qpos[self.drivers].tolist()
        openings = [
            self.opening_at(left + other_left),
            self.opening_at(right + other_right),
        ]
        return DuoState(
            joints=self._qpos[self.joints],
            openings=np.array([min(max(opening, 0.0), 1.0) for opening in openings]),
            tcp_poses=np.array(tools).reshape(2, 7),
        )

    def joint_velocities(self) -> Array:
        """Joint velocities (2, 7) in rad/s, as of the last physics step."""
        return self._data.qvel[self.dofs]

    def opening_at(self, drives: Any) -> Any:
        """Opening of a gripper by the sum of the positions of its two drives, not limited."""
        return 1.0 - drives * self._closed_by_drives

    def controls_of(self, commands: Array) -> Array:
        """Controls of the actuators for flat commands (..., 16), as a copy."""
        controls = commands.copy()
        closed = self.robot.gripper.ctrl_closed
        controls[..., _OPENINGS] = closed * (1.0 - commands[..., _OPENINGS])
        return controls

    def commands_of(self, controls: Array) -> Array:
        """The flat commands (..., 16) that actuators hold, as a copy."""
        commands = controls.copy()
        closed = self.robot.gripper.ctrl_closed
        commands[..., _OPENINGS] = 1.0 - commands[..., _OPENINGS] / closed
        return commands


def ramp(start: Array, end: Array) -> Array:
    """Controls (..., 16 substeps, n) that lead linearly from some (..., n) to others, exactly."""
    rows = start[..., None, :] + _FRACTIONS * (end - start)[..., None, :]
    rows[..., -1, :] = end
    return rows


def _actuators(model: mujoco.MjModel) -> slice:
    """Slice of the robot's actuators in ctrl, in the order of a flat command."""
    names = [
        name for side in SIDES for name in (*arm_joint_names(side), gripper_name(side))
    ]
    first = resolve(model, mujoco.mjtObj.mjOBJ_ACTUATOR, names[0])
    actuators = slice(first, first + len(names))
    present = names_of(model, mujoco.mjtObj.mjOBJ_ACTUATOR)
    if present[actuators] != names:
        raise DuoBenchError(
            f"The robot's actuators must follow each other in the order {', '.join(names)}; "
            f"the model has {', '.join(present)}."
        )
    return actuators
