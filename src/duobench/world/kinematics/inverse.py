"""Inverse kinematics of both arms, differential, on a model of each arm alone.

Each step is a small quadratic program: `mink` says what brings the tool nearer, posture and inertia
pull at the joints, and DAQP solves it within each joint's bounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from duobench.core.spatial import SE3, length, product
from duobench.core.types import (
    ARM_JOINTS,
    CONTROL_HZ,
    SIDES,
    Array,
    Side,
)
from duobench.world.robot.frames import LINK7_FROM_TCP, SHOULDERS
from duobench.world.robot.joints import HOME_JOINTS, VELOCITY_LIMITS
from duobench.world.scene.naming import tcp_name

if TYPE_CHECKING:
    import mink

POSITION_COST, ORIENTATION_COST = 1.0, 0.3
"""Weights of one metre and of one radian of error: 3 mm weigh as much as half a degree."""
POSTURE_COST = 5e-3
"""Pull of the redundant joint towards the home posture; weak enough not to show at the tool."""
POSTURE_GAIN = 0.05
"""Share of its error that the posture may remove in a step: all of it at once, at full speed, the
redundant joint overshoots and swings."""
LIMIT_MARGIN = 0.05
"""Distance in radians that solutions keep from the ends of the joints' ranges."""
LIMIT_GAIN = 0.24
"""Share of its distance from there that a joint may come nearer in a step: so even the fastest one
brakes by less than `MAX_CHANGE` a step."""
GRID = 2.0**20
"""Joint targets are whole multiples of 1 / GRID radians (one micrometre at the tool), so that the
last bits of a solution, which differ between processors, are gone. float32 holds them exactly."""
VELOCITY_SHARE = 0.9
"""Part of the arm's velocity limits that a solution may use."""
MAX_CHANGE = 0.038
"""Largest change in radians of a joint's step against the one before, where that one is given: so
no target jumps by more than 0.05 rad a step², nor reverses by more than 0.02 rad."""
INERTIA_COST = 0.02
"""Weight of a change of the step against the one before, where that one is given: near a singular
posture, where a small way of the tool takes long ways of the joints, they take them evenly."""
DAMPING = 1e-5
"""Weight of the squared step itself, which shortens such ways; too weak to show at the tool."""
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
"""Halvings of a step that does not remove as much, before the arm rests."""
OPTIMAL = 1
"""Status of DAQP for a found solution."""

_WRIST_IN_TOOL = LINK7_FROM_TCP.inverse().translation
_NO_ROWS = np.zeros((0, ARM_JOINTS))
"""No limits but bounds of the joints themselves."""


def within_reach(
    side: Side,
    tool: SE3,
    reach: float = REACH,
) -> SE3:
    """The tool pose, brought towards the arm's shoulder as far as its wrist is out of reach."""
    shoulder = SHOULDERS[side]
    away = product(tool.rotation, _WRIST_IN_TOOL) + tool.translation - shoulder
    distance = length(away)
    excess = max(0.0, distance - reach)
    return tool.moved(*(-excess * away / distance)) if excess else tool


class ArmKinematics:
    """Solves for the joints of one arm; holds no state between calls."""

    def __init__(self, side: Side) -> None:
        # mink brings MuJoCo and SciPy, which joint actions do without.
        import mink

        from duobench.world.scene.arms import kinematic_model

        model = kinematic_model(side)
        model.jnt_range += (LIMIT_MARGIN, -LIMIT_MARGIN)
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
        self._cost = self._tool.cost
        self._speeds = np.array(VELOCITY_LIMITS) * VELOCITY_SHARE

    def forward(self, joints: Array) -> SE3:
        """Tool pose in the table frame at joint positions (7,)."""
        self._configuration.update(joints)
        pose = self._configuration.get_transform_frame_to_world(
            tcp_name(self._side), "site"
        )
        return SE3(pose.rotation().as_matrix(), pose.translation())

    def step(
        self,
        joints: Array,
        targets: Sequence[SE3],
        dt: float,
        posture: Array,
        before: Array | None,
    ) -> Array:
        """Joint targets (n, 7) for the steps of n arms towards a tool pose each.

        What each gets does not depend on the others; see `Kinematics.step`.
        """
        start = np.minimum(np.maximum(joints, self._low), self._high)
        goals = [self._goal(target) for target in targets]
        errors = np.empty((len(goals), len(self._cost)))
        jacobians = np.empty((*errors.shape, ARM_JOINTS))
        for row, goal in enumerate(goals):
            errors[row] = self._error(start[row], goal)
            jacobians[row] = self._tool.compute_jacobian(self._configuration)
        errors *= self._cost
        jacobians *= self._cost[:, None]
        last = None if before is None else joints - before
        changes = self._changes(errors, jacobians, start, dt, posture, last)
        moved = start + changes
        if last is not None:  # the arm moves on, and cannot stop at once
            return moved
        enough = (1.0 - LEAST_PROGRESS) * _objective(errors, start - posture)
        rows = np.arange(len(goals))
        for _ in range(SHORTENINGS + 1):
            tried = moved[rows]
            errors = np.empty((len(rows), len(self._cost)))
            for row, number in enumerate(rows.tolist()):
                errors[row] = self._error(tried[row], goals[number])
            errors *= self._cost
            rows = rows[~(_objective(errors, tried - posture) < enough[rows])]
            if not len(rows):
                return moved
            changes[rows] /= 2
            moved[rows] = start[rows] + changes[rows]
        moved[rows] = start[rows]
        return moved

    def _goal(self, target: SE3) -> mink.SE3:
        """A tool pose, within reach, as `mink` takes it."""
        import mink

        goal = within_reach(self._side, target)
        return mink.SE3(np.concatenate([goal.wxyz, goal.translation]))

    def _error(self, joints: Array, goal: mink.SE3) -> Array:
        """Error (6,) of the tool at joint positions (7,), to which the model is brought."""
        self._tool.transform_target_to_world = goal
        self._configuration.update(joints)
        return self._tool.compute_error(self._configuration)

    def _changes(
        self,
        errors: Array,
        jacobians: Array,
        start: Array,
        dt: float,
        posture: Array,
        last: Array | None,
    ) -> Array:
        """The best steps (n, 7) from `start` by weighted errors; none where none is found."""
        import daqp

        pull = POSTURE_COST**2
        linear = pull * POSTURE_GAIN * (start - posture)
        linear += (errors[:, None] @ jacobians)[:, 0]
        if last is not None:
            pull += INERTIA_COST**2
            linear -= INERTIA_COST**2 * last
        hessians = jacobians.swapaxes(1, 2) @ jacobians
        damping = pull + DAMPING + LM_DAMPING * np.vecdot(errors, errors)
        diagonals = hessians.reshape(len(start), -1)[:, :: ARM_JOINTS + 1]
        diagonals += damping[:, None]
        low, high = self._bounds(start, dt, last)
        changes = np.zeros(start.shape)
        for row in range(len(start)):
            solution, _, outcome, _ = daqp.solve(
                hessians[row], linear[row], _NO_ROWS, high[row], low[row]
            )
            if outcome == OPTIMAL:
                changes[row] = solution
        return changes

    def _bounds(
        self, start: Array, dt: float, last: Array | None
    ) -> tuple[Array, Array]:
        """Bounds of each joint's motion in a step: range, speed, and change of speed."""
        most = self._speeds * dt
        low = np.maximum(-most, LIMIT_GAIN * (self._low - start))
        high = np.minimum(most, LIMIT_GAIN * (self._high - start))
        if last is None:
            return low, high
        slowest, fastest = last - MAX_CHANGE, last + MAX_CHANGE
        return (
            np.minimum(np.maximum(slowest, low), high),
            np.minimum(np.maximum(fastest, low), high),
        )


def _objective(tools: Array, from_posture: Array) -> Array:
    """The squared errors (n,) of tools (n, 6), weighted already, and of postures (n, 7)."""
    pulled = POSTURE_COST * from_posture
    return np.vecdot(tools, tools) + np.vecdot(pulled, pulled)


class Kinematics:
    """Solves for joint targets that bring the tools towards poses; holds no state between calls."""

    def __init__(self) -> None:
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
        before: Array | None = None,
    ) -> Array:
        """One step towards tool poses, within joint ranges and velocity limits.

        Without `before`, each step brings an arm nearer to its target, so towards a still target it
        comes to rest, in reach or not; where no step does, or the solver finds none, the arm stays.
        With it, joints also keep to `MAX_CHANGE`: smooth for targets that move smoothly.

        Args:
            joints: Where the arms are (2, 7), in radians. From outside the ranges that solutions
                keep to, an arm starts at the nearest position within.
            targets: Tool pose wanted for each side; a side that is missing stays.
            dt: Duration of the step in seconds.
            posture: Joint positions (2, 7) that the redundant joint is attracted to.
            before: Where the arms were one step earlier (2, 7), in radians.

        Returns:
            Joint targets (2, 7), whole multiples of 1 / `GRID` for the sides that have a target.
        """
        return self.step_all(
            np.asarray(joints)[None],
            {side: [target] for side, target in targets.items()},
            dt=dt,
            posture=posture,
            before=None if before is None else before[None],
        )[0]

    def step_all(
        self,
        joints: Array,
        targets: Mapping[Side, Sequence[SE3]],
        *,
        dt: float = 1.0 / CONTROL_HZ,
        posture: Array = HOME_JOINTS,
        before: Array | None = None,
    ) -> Array:
        """`step` of n robots at once (n, 2, 7), each with a target for each side that has some."""
        result = np.array(joints, dtype=np.float64)
        for side, goals in targets.items():
            row = side.index
            solutions = self._arms[side].step(
                result[:, row],
                goals,
                dt,
                posture[row],
                None if before is None else before[:, row],
            )
            result[:, row] = np.rint(solutions * GRID) / GRID
        return result

    def solve(
        self,
        joints: Array,
        targets: Mapping[Side, SE3],
        *,
        tolerance: float = 1e-4,
        max_steps: int = 100,
    ) -> tuple[Array, bool]:
        """Steps from joints (2, 7) in radians until the tools are at their targets.

        Returns the joint targets (2, 7) nearest to the start, and whether the tolerance, in metres
        and radians, was met within the steps.
        """
        current = np.asarray(joints, dtype=np.float64)
        for _ in range(max_steps):
            poses = self.forward(current)
            errors = [max(poses[side].distance(pose)) for side, pose in targets.items()]
            if max(errors, default=0.0) < tolerance:
                return current, True
            current = self.step(
                current,
                targets,
                dt=1.0,
                posture=current,
            )
        return current, False
