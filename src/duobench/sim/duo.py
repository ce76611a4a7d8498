"""The two arms in simulation: commands in, state out."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.scene.compose import SUBSTEPS
from duobench.scene.fr3 import HOME_JOINTS
from duobench.scene.robotiq import CTRL_CLOSED, DRIVER_CLOSED
from duobench.sim.handles import DuoHandles
from duobench.spatial import wxyz_from_matrix
from duobench.types import ARM_JOINTS, FLAT_SIZE, SIDE_SIZE, DuoCommand, DuoState

Array = NDArray[np.float64]

HOME = DuoCommand(joints=HOME_JOINTS, openings=np.ones(2))
"""Both arms at home, both grippers open."""

_OPENING_SLOTS = np.array([ARM_JOINTS, ARM_JOINTS + SIDE_SIZE])


class Duo:
    """Translates between flat commands and the engine's arrays of one model."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Resolve the robot's handles."""
        self.handles = DuoHandles.of(model)
        self._data = data
        self._fractions = (np.arange(1, SUBSTEPS + 1) / SUBSTEPS)[:, None]
        ranges = np.zeros((FLAT_SIZE, 2))
        joints = np.delete(np.arange(FLAT_SIZE), _OPENING_SLOTS)
        ranges[joints] = model.jnt_range[self.handles.joints.ravel()]
        ranges[_OPENING_SLOTS] = 0.0, 1.0
        self.low, self.high = ranges.T
        """Limits of a flat command, (16,) each."""

    def ramp(self, command: DuoCommand) -> Array:
        """Controls (16 substeps, 16 actuators) that lead linearly from the last to the new ones."""
        start = self._data.ctrl[self.handles.actuators]
        return start + self._fractions * (self._controls(command) - start)

    def hold(self, command: DuoCommand) -> None:
        """Put the arms at a command without moving there: positions, controls, linkages open.

        The linkages of the grippers are at rest at opening 1, the only one that this accepts.
        """
        if not np.all(command.openings == 1.0):
            raise ValueError("The arms can be placed with open grippers only.")
        self._data.qpos[self.handles.qpos] = command.joints
        self._data.ctrl[self.handles.actuators] = self._controls(command)

    def command(self) -> DuoCommand:
        """The last command, as the actuators hold it."""
        flat = self._data.ctrl[self.handles.actuators].copy()
        flat[_OPENING_SLOTS] = 1.0 - flat[_OPENING_SLOTS] / CTRL_CLOSED
        return DuoCommand.from_flat(flat)

    def read(self) -> DuoState:
        """Joint positions, openings and tool poses, as of the last physics step."""
        data, handles = self._data, self.handles
        tools = np.empty((2, 7))
        for row, site in enumerate(handles.tcp_sites):
            tools[row, :3] = data.site_xpos[site]
            w, x, y, z = wxyz_from_matrix(data.site_xmat[site].reshape(3, 3))
            tools[row, 3:] = x, y, z, w
        closed = data.qpos[handles.drivers].mean(axis=1) / DRIVER_CLOSED
        return DuoState(
            joints=data.qpos[handles.qpos],
            openings=np.clip(1.0 - closed, 0.0, 1.0),
            tool_poses=tools,
        )

    @staticmethod
    def _controls(command: DuoCommand) -> Array:
        controls = command.flat
        controls[_OPENING_SLOTS] = CTRL_CLOSED * (1.0 - controls[_OPENING_SLOTS])
        return controls
