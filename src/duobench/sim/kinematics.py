"""Inverse kinematics of both arms, differential, by `mink` on a model of the arms alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import mink
import numpy as np
from numpy.typing import NDArray

from duobench.scene.fr3 import HOME_JOINTS, SHOULDERS, VELOCITY_LIMITS
from duobench.scene.naming import arm_joint_names, tcp_name
from duobench.scene.robot import LINK7_FROM_TCP, kinematic_model
from duobench.spatial import SE3
from duobench.types import ARM_JOINTS, CONTROL_HZ, SIDES, Side

Array = NDArray[np.float64]

POSITION_COST, ORIENTATION_COST = 1.0, 0.3
"""Weights of one metre and of one radian of error: 3 mm weigh as much as half a degree."""
POSTURE_COST = 2e-3
"""Pull of the redundant joint towards the home posture; weak enough not to show at the tool."""
VELOCITY_SHARE = 0.9
"""Part of the arm's velocity limits that a solution may use."""
LM_DAMPING = 0.1
"""Damping for each unit of squared error: a target that is far away, or out of reach, is approached
in many small steps. It fades as the tool comes near, and does not show in tracking."""
REACH = 0.79
"""Largest distance in metres from the middle of an arm's shoulder to that of its last wrist joint.
Stretched, it is 0.80: upper arm and forearm at joint 4's limit, and the offset of the hand."""
SHORTENINGS = 5
"""How often a step that does not bring the tools nearer is halved, before the arms hold."""
SOLVER = "daqp"

_TCP_FROM_WRIST = LINK7_FROM_TCP.inverse()


def within_reach(side: Side, tool: SE3) -> SE3:
    """The tool pose, brought towards the arm's shoulder as far as its wrist is out of reach."""
    shoulder = SHOULDERS[side]
    away = (tool @ _TCP_FROM_WRIST).translation - shoulder
    excess = max(0.0, float(np.linalg.norm(away)) - REACH)
    return tool.moved(*(-excess * away / np.linalg.norm(away))) if excess else tool


class Kinematics:
    """Solves for joint targets that bring the tools towards poses; holds no state between calls."""

    def __init__(self) -> None:
        """Build the kinematic model and the tasks."""
        model = kinematic_model()
        self._configuration = mink.Configuration(model)
        self._tasks = {
            side: mink.FrameTask(
                tcp_name(side),
                "site",
                position_cost=POSITION_COST,
                orientation_cost=ORIENTATION_COST,
                lm_damping=LM_DAMPING,
            )
            for side in SIDES
        }
        self._posture = mink.PostureTask(model, cost=POSTURE_COST)
        self._range = mink.ConfigurationLimit(model)
        speeds = np.array(VELOCITY_LIMITS) * VELOCITY_SHARE
        self._speed = mink.VelocityLimit(
            model,
            {
                name: float(speed)
                for side in SIDES
                for name, speed in zip(arm_joint_names(side), speeds, strict=True)
            },
        )

    def forward(self, joints: Array) -> dict[Side, SE3]:
        """Tool poses in the table frame at joint positions (2, 7)."""
        self._configuration.update(np.asarray(joints).ravel())
        return {side: self._tool(side) for side in SIDES}

    def step(
        self,
        joints: Array,
        targets: Mapping[Side, SE3],
        *,
        dt: float = 1.0 / CONTROL_HZ,
        posture: Array = HOME_JOINTS,
    ) -> Array:
        """One step towards tool poses, within joint ranges and velocity limits.

        Each step brings the arms nearer to the targets, so towards still targets they come to rest,
        in reach or not. Where no step does, or the solver finds none, they stay.

        Args:
            joints: Where the arms are (2, 7), in radians.
            targets: Tool pose wanted for each side; a side that is missing stays.
            dt: Duration of the step in seconds.
            posture: What the redundant joint is drawn to (2, 7).

        Returns:
            Joint targets (2, 7).
        """
        start = np.asarray(joints, dtype=np.float64)
        self._configuration.update(start.ravel())
        tasks: list[mink.Task] = [self._posture]
        self._posture.set_target(np.asarray(posture).ravel())
        for side, pose in targets.items():
            task = self._tasks[side]
            goal = within_reach(side, pose)
            task.set_target(mink.SE3(np.concatenate([goal.wxyz, goal.translation])))
            tasks.append(task)
        error = self._error(tasks)
        try:
            velocity = mink.solve_ik(
                self._configuration, tasks, dt, SOLVER, limits=[self._range, self._speed]
            )
        except mink.NoSolutionFound:
            return start
        change = (velocity * dt).reshape(2, ARM_JOINTS)
        change[[side.index for side in SIDES if side not in targets]] = 0.0
        for _ in range(SHORTENINGS + 1):
            self._configuration.update((start + change).ravel())
            if self._error(tasks) < error:
                return start + change
            change = change / 2
        return start

    def solve(
        self,
        joints: Array,
        targets: Mapping[Side, SE3],
        *,
        tolerance: float = 1e-4,
        max_steps: int = 100,
    ) -> tuple[Array, bool]:
        """Steps until the tools are at their targets.

        Args:
            joints: Start (2, 7), in radians; the solution nearest to it is found.
            targets: Tool pose wanted for each side.
            tolerance: Error allowed, metres and radians.
            max_steps: Steps after which it gives up.

        Returns:
            Joint targets (2, 7), and whether the tolerance was met.
        """
        current = np.asarray(joints, dtype=np.float64)
        for _ in range(max_steps):
            poses = self.forward(current)
            errors = [max(poses[side].distance(pose)) for side, pose in targets.items()]
            if max(errors, default=0.0) < tolerance:
                return current, True
            current = self.step(current, targets, dt=1.0, posture=current)
        return current, False

    def _error(self, tasks: Iterable[mink.Task]) -> float:
        """What a solution makes small: the squared errors of all tasks, each by its cost."""
        weighted = (task.cost * task.compute_error(self._configuration) for task in tasks)
        return sum(float(error @ error) for error in weighted)

    def _tool(self, side: Side) -> SE3:
        pose = self._configuration.get_transform_frame_to_world(tcp_name(side), "site")
        return SE3(pose.rotation().as_matrix(), pose.translation())
