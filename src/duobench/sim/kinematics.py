"""Inverse kinematics of both arms, differential, by `mink` on a model of each arm alone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from duobench.scene.fr3 import HOME_JOINTS, SHOULDERS, VELOCITY_LIMITS
from duobench.scene.naming import arm_joint_names, tcp_name
from duobench.scene.robot import LINK7_FROM_TCP, kinematic_model
from duobench.spatial import SE3, length
from duobench.types import CONTROL_HZ, SIDES, Array, Side

POSITION_COST, ORIENTATION_COST = 1.0, 0.3
"""Weights of one metre and of one radian of error: 3 mm weigh as much as half a degree."""
POSTURE_COST = 2e-3
"""Pull of the redundant joint towards the home posture; weak enough not to show at the tool."""
VELOCITY_SHARE = 0.9
"""Part of the arm's velocity limits that a solution may use."""
LM_DAMPING = 0.1
"""Damping for each unit of squared error: a target that is far away, or out of reach, is approached
in many small steps. It fades as the tool comes near, and does not show in tracking."""
REACH = 0.795
"""Largest distance in metres from the middle of an arm's shoulder to that of its last wrist joint.
Stretched, it is 0.807: upper arm 0.327, forearm 0.393, hand 0.088 [Menagerie franka_fr3]."""
ELBOW, STRAIGHT = 3, -0.5
"""Index of the elbow's joint (4) in an arm, and the largest angle in radians that it is bent to.
Stretched, it is at -0.467. Beyond, the arm would bend the other way, and stick at the joint's end
at -0.152 when it is to come back."""
LEAST_PROGRESS = 1e-3
"""Share of the squared error that a step removes at least; otherwise the arm rests."""
SHORTENINGS = 5
"""How often a step that does not remove as much is halved, before the arm rests."""
SOLVER = "daqp"

_TCP_FROM_WRIST = LINK7_FROM_TCP.inverse()


def within_reach(side: Side, tool: SE3) -> SE3:
    """The tool pose, brought towards the arm's shoulder as far as its wrist is out of reach."""
    shoulder = SHOULDERS[side]
    away = (tool @ _TCP_FROM_WRIST).translation - shoulder
    distance = length(away)
    excess = max(0.0, distance - REACH)
    return tool.moved(*(-excess * away / distance)) if excess else tool


class ArmKinematics:
    """Solves for the joints of one arm; holds no state between calls."""

    def __init__(self, side: Side) -> None:
        """Build the arm's kinematic model and the tasks."""
        import mink  # it brings SciPy, which joint actions do without

        model = kinematic_model(side)
        model.jnt_range[ELBOW, 1] = STRAIGHT
        self._low, self._high = model.jnt_range.T
        self._side = side
        self._configuration = mink.Configuration(model)
        self._tool = mink.FrameTask(
            tcp_name(side),
            "site",
            position_cost=POSITION_COST,
            orientation_cost=ORIENTATION_COST,
            lm_damping=LM_DAMPING,
        )
        self._posture = mink.PostureTask(model, cost=POSTURE_COST)
        speeds = np.array(VELOCITY_LIMITS) * VELOCITY_SHARE
        names = arm_joint_names(side)
        self._limits = [
            mink.ConfigurationLimit(model),
            mink.VelocityLimit(model, dict(zip(names, speeds.tolist(), strict=True))),
        ]

    def forward(self, joints: Array) -> SE3:
        """Tool pose in the table frame at joint positions (7,)."""
        self._configuration.update(joints)
        pose = self._configuration.get_transform_frame_to_world(tcp_name(self._side), "site")
        return SE3(pose.rotation().as_matrix(), pose.translation())

    def step(self, joints: Array, target: SE3, dt: float, posture: Array) -> Array:
        """Joint targets (7,) one step nearer to a tool pose; see `Kinematics.step`."""
        import mink

        start = np.clip(joints, self._low, self._high)
        goal = within_reach(self._side, target)
        self._tool.set_target(mink.SE3(np.concatenate([goal.wxyz, goal.translation])))
        self._posture.set_target(posture)
        enough = (1.0 - LEAST_PROGRESS) * self._error(start)
        tasks = [self._tool, self._posture]
        try:
            velocity = mink.solve_ik(self._configuration, tasks, dt, SOLVER, limits=self._limits)
        except mink.NoSolutionFound:
            return start
        change = velocity * dt
        for _ in range(SHORTENINGS + 1):
            if self._error(start + change) < enough:
                return start + change
            change = change / 2
        return start

    def _error(self, joints: Array) -> float:
        """What a solution makes small: the squared errors of tool and posture, by their costs."""
        self._configuration.update(joints)
        errors = (
            task.cost * task.compute_error(self._configuration)
            for task in (self._tool, self._posture)
        )
        return sum(float(error @ error) for error in errors)


class Kinematics:
    """Solves for joint targets that bring the tools towards poses; holds no state between calls."""

    def __init__(self) -> None:
        """Build the solvers of both arms, which do not depend on each other."""
        self._arms = {side: ArmKinematics(side) for side in SIDES}

    def forward(self, joints: Array) -> dict[Side, SE3]:
        """Tool poses in the table frame at joint positions (2, 7)."""
        return {side: self._arms[side].forward(joints[side.index]) for side in SIDES}

    def step(
        self,
        joints: Array,
        targets: Mapping[Side, SE3],
        *,
        dt: float = 1.0 / CONTROL_HZ,
        posture: Array = HOME_JOINTS,
    ) -> Array:
        """One step towards tool poses, within joint ranges and velocity limits.

        Each step brings an arm nearer to its target, so towards a still target it comes to rest, in
        reach or not. Where no step does, or the solver finds none, the arm stays.

        Args:
            joints: Where the arms are (2, 7), in radians. From outside the ranges that solutions
                keep to, an arm starts at the nearest position within.
            targets: Tool pose wanted for each side; a side that is missing stays.
            dt: Duration of the step in seconds.
            posture: Joint positions (2, 7) that the redundant joint is attracted to.

        Returns:
            Joint targets (2, 7).
        """
        result = np.array(joints, dtype=np.float64)
        for side, target in targets.items():
            row = side.index
            result[row] = self._arms[side].step(result[row], target, dt, posture[row])
        return result

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
