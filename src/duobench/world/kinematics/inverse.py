"""Inverse kinematics of both arms, differential, on a model of each arm alone.

Each step is a small quadratic program: `mink` says what brings the tool nearer, posture and inertia
pull at the joints, and DAQP solves it within each joint's bounds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from duobench.core.spatial import (
    SE3,
    rows_from_wxyz,
    sum_of_products,
    unit_quaternion,
    wxyz_from_rows,
)
from duobench.core.types import (
    ARM_JOINTS,
    CONTROL_HZ,
    SIDES,
    Array,
    Side,
)
from duobench.world.robot.frames import Robot
from duobench.world.robot.joints import VELOCITY_LIMITS
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

_NO_ROWS = np.zeros((0, ARM_JOINTS))
"""No limits but bounds of the joints themselves."""


def within_reach(
    robot: Robot,
    side: Side,
    tool: SE3,
    reach: float = REACH,
) -> SE3:
    """The tool pose, brought towards the arm's shoulder as far as its wrist is out of reach."""
    wrist = robot.link7_from_tcp.inverse().translation.tolist()
    shoulder = robot.shoulders[side].tolist()
    position = tool.translation.tolist()
    nearer = _within_reach(wrist, shoulder, tool.rotation.tolist(), position, reach)
    return tool if nearer is position else SE3(tool.rotation, np.array(nearer))


def _within_reach(
    wrist: list[float],
    shoulder: list[float],
    rotation: list[list[float]],
    position: list[float],
    reach: float = REACH,
) -> list[float]:
    """`within_reach` in Python's floats: the position of the tool alone, the same if it is.

    The wrist is given in the tool's frame, the shoulder in the table's.
    """
    wx, wy, wz = wrist
    away = [
        x * wx + y * wy + z * wz + place - origin
        for (x, y, z), place, origin in zip(rotation, position, shoulder, strict=True)
    ]
    distance = math.sqrt(sum_of_products(away, away))
    excess = distance - reach
    if not excess > 0.0:
        return position
    return [
        place + -excess * part / distance
        for place, part in zip(position, away, strict=True)
    ]


class ArmKinematics:
    """Solves for the joints of one arm; holds no state between calls."""

    def __init__(self, side: Side, robot: Robot) -> None:
        # mink brings MuJoCo and SciPy, which joint actions do without.
        import mink

        from duobench.world.scene.arms import kinematic_model

        model = kinematic_model(side, robot)
        model.jnt_range += (LIMIT_MARGIN, -LIMIT_MARGIN)
        model.jnt_range[ELBOW, 1] = STRAIGHT
        self._low, self._high = model.jnt_range.T
        self._ends = np.array([[self._low], [self._high]])
        self._side = side
        self._wrist = robot.link7_from_tcp.inverse().translation.tolist()
        self._shoulder = robot.shoulders[side].tolist()
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
        poses: Sequence[Array],
        dt: float,
        posture: Array,
        before: Array | None,
    ) -> Array:
        """Joint targets (n, 7) for the steps of n arms towards a tool pose each.

        What each gets does not depend on the others; see `Kinematics.step`.

        Args:
            joints: Where the arms are (n, 7), in radians.
            poses: A pose (7,) for each, within its reach, as `mink` takes them: w x y z, x y z.
            dt: Duration of the step in seconds.
            posture: Joint positions (7,) that the redundant joint is attracted to.
            before: Where the arms were one step earlier (n, 7), if it counts.
        """
        import mink

        start = np.minimum(np.maximum(joints, self._low), self._high)
        goals = [mink.SE3(pose) for pose in poses]
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

    def goal(self, rotation: list[list[float]], position: list[float]) -> Array:
        """A tool pose within reach as `mink` takes it (7,): quaternion w x y z, and position."""
        nearer = _within_reach(self._wrist, self._shoulder, rotation, position)
        return np.array([*wxyz_from_rows(rotation), *nearer])

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
        diagonals = hessians.reshape(-1, ARM_JOINTS**2)[:, :: ARM_JOINTS + 1]
        diagonals += damping[:, None]
        low, high = self._bounds(start, dt, last)
        changes = np.zeros(start.shape)
        programs = zip(hessians, linear, high, low, changes, strict=True)
        for hessian, pulls, most, least, change in programs:
            solution, _, outcome, _ = daqp.solve(hessian, pulls, _NO_ROWS, most, least)
            if outcome == OPTIMAL:
                change[:] = solution
        return changes

    def _bounds(
        self, start: Array, dt: float, last: Array | None
    ) -> tuple[Array, Array]:
        """Bounds of each joint's motion in a step: range, speed, and change of speed."""
        most = self._speeds * dt
        ways = LIMIT_GAIN * (self._ends - start)
        low, high = np.minimum(np.maximum(-most, ways), most)
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

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        """Arms whose joints it solves for."""
        self._arms = {side: ArmKinematics(side, robot) for side in SIDES}

    def forward(self, joints: Array) -> dict[Side, SE3]:
        """Tool poses in the table frame at joint positions (2, 7)."""
        return {side: self._arms[side].forward(joints[side.index]) for side in SIDES}

    def step(
        self,
        joints: Array,
        targets: Mapping[Side, SE3],
        *,
        dt: float = 1.0 / CONTROL_HZ,
        posture: Array | None = None,
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
            posture: Joint positions (2, 7) that the redundant joint is attracted to; home where
                none are given.
            before: Where the arms were one step earlier (2, 7), in radians.

        Returns:
            Joint targets (2, 7), whole multiples of 1 / `GRID` for the sides that have a target.
        """
        goals = {
            side: [
                self._arms[side].goal(pose.rotation.tolist(), pose.translation.tolist())
            ]
            for side, pose in targets.items()
        }
        posture = self.robot.home if posture is None else posture
        start = np.array(joints, dtype=np.float64)[None]
        earlier = None if before is None else before[None]
        return self._step(start, goals, dt, posture, earlier)[0]

    def step_all(self, joints: Array, poses: Array) -> Array:
        """`step` of n robots at once, from (n, 2, 7), towards poses (n, 2, 7) x y z qx qy qz qw."""
        goals: dict[Side, list[Array]] = {}
        for side in SIDES:
            goals[side] = []
            for x, y, z, qx, qy, qz, qw in poses[:, side.index].tolist():
                rotation = rows_from_wxyz(unit_quaternion((qw, qx, qy, qz)))
                goals[side].append(self._arms[side].goal(rotation, [x, y, z]))
        start = np.array(joints, dtype=np.float64)
        return self._step(start, goals, 1.0 / CONTROL_HZ, self.robot.home, None)

    def _step(
        self,
        joints: Array,
        goals: Mapping[Side, Sequence[Array]],
        dt: float,
        posture: Array,
        before: Array | None,
    ) -> Array:
        """Joint targets for n robots, written over where they are (n, 2, 7)."""
        for side, poses in goals.items():
            row = side.index
            solutions = self._arms[side].step(
                joints[:, row],
                poses,
                dt,
                posture[row],
                None if before is None else before[:, row],
            )
            joints[:, row] = np.rint(solutions * GRID) / GRID
        return joints

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
