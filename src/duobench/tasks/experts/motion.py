"""Motions of the arms: the vocabulary that scripted experts are written in.

A script is a generator: every `yield` is one control step. Scripts set tool poses and gripper
openings; once a step, inverse kinematics turns the poses into the 16 joint-space numbers that
every policy sends. Scripts may read the simulator's state, and act in no other way. Where a motion
may differ from episode to episode, the vocabulary asks the sample of a variety by how much.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import (
    CONTROL_HZ,
    SIDES,
    Array,
    DuoCommand,
    Side,
)
from duobench.tasks.experts.variety import VarietySample
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.scene.naming import tcp_name

if TYPE_CHECKING:
    from duobench.world.sim.simulation import Simulation

Script = Generator[None, None, None]
"""One control step for every `yield`."""

CONTROL_STEP = 1.0 / CONTROL_HZ
"""Seconds in one control step."""
SPEED = 0.45
"""Mean speed of a free motion in m/s."""
TURN_SPEED = 1.8
"""Mean angular speed of a free motion in rad/s."""
ARRIVED = 0.004
"""Distance in metres at which a tool has arrived; the servo lags by a tenth of a second."""
ARRIVED_TURN = 0.03
"""Angle in radians at which a tool has arrived."""
MAX_ARRIVAL_STEPS = 20
"""Control steps that a motion waits for the tool to arrive."""
OPEN, CLOSED = 1.0, 0.0
GRIP_TIME = 1.2
"""Largest time that a gripper waits for its fingers to come to rest, in whole ways of them."""
AT_REST = 0.004
"""Change of an opening in one control step below which fingers have come to rest."""
NEAR = 0.012
"""Distance in metres at which a tool has passed a point on its way."""
CAREFUL = 0.25
"""Mean speed in m/s of a tool that comes to an object, or brings one to its place."""


TIPS = 0.0229
"""Reach of fingertips beyond the tool, in metres, for which scripts are written."""
LENGTH = 0.1722
"""Way from the flange to the fingertips, in metres, for which they are."""
FORCE = 100.0
"""Force of the fingers in N for which they are."""


class Arms:
    """Both arms as a script moves them: tool targets, openings, and what the simulator shows.

    Tools of scripts have fingertips that reach `TIPS` beyond them; where a gripper's reach less,
    its tool is led as much further along its own z.
    """

    def __init__(
        self,
        simulation: Simulation,
        kinematics: Kinematics | None = None,
        variety: VarietySample | None = None,
        latency: int = 0,
    ) -> None:
        """Start at what the arms were last commanded.

        Args:
            simulation: Read only; a script never writes to it.
            kinematics: Solver to share between episodes; a new one if not given.
            variety: What this episode does differently; nothing if not given.
            latency: Control steps from an action to its execution.
        """
        self.sim = simulation
        self.kinematics = kinematics or Kinematics(simulation.robot)
        command = simulation.duo.command()
        self.joints: Array = command.joints.copy()
        """Commanded joints (2, 7) in radians."""
        self.before: Array = self.joints
        """Commanded joints (2, 7) one step earlier, in radians."""
        self.openings: Array = command.openings.copy()
        """Commanded openings (2,), 0 closed to 1 open."""
        gripper = simulation.robot.gripper
        self.deeper = TIPS - gripper.tips
        """How much further along its z than a script's tool that of the gripper is, in metres."""
        self.shorter = max(0.0, LENGTH - gripper.tool_offset - gripper.tips)
        """How much nearer palm, camera and wrist come to what fingers reach into, in metres."""
        self.firmness = min(1.0, gripper.force / FORCE)
        """Share of the usual speed at which what is held far from its middle does not swivel."""
        self.targets: dict[Side, SE3] = {
            side: self._script_tool(pose)
            for side, pose in self.kinematics.forward(self.joints).items()
        }
        """Tool pose that each arm is being led to, in the table frame."""
        self.variety = variety or VarietySample()
        """Variations of this episode."""
        self.latency = latency
        """Control steps from an action to its execution: so much later a script sees its effect."""
        self.freedom: Array = np.zeros(len(SIDES))
        """Freedom of each arm's motion at this moment (2,), 0 to 1."""

    def action(self) -> Array:
        """The next 16 numbers: one step of inverse kinematics towards the targets."""
        before, self.before = self.before, self.joints
        targets = self.targets
        if self.deeper:
            deeper = SE3.at(z=self.deeper)
            targets = {side: target @ deeper for side, target in targets.items()}
        self.joints = self.kinematics.step(self.joints, targets, before=before)
        return DuoCommand(joints=self.joints, openings=self.openings).flat

    def tcp_pose(self, side: Side) -> SE3:
        """Measured pose of a tool centre point, in the table frame."""
        return self._script_tool(self.sim.site_pose(tcp_name(side)))

    def _script_tool(self, tool: SE3) -> SE3:
        """Pose of the tool of scripts where that of the gripper is."""
        return tool @ SE3.at(z=-self.deeper) if self.deeper else tool

    def opening(self, side: Side) -> float:
        """Measured opening of a gripper, 0 to 1."""
        return float(self.sim.duo.read().openings[side.index])

    def grasps(self, side: Side, body: str) -> bool:
        """Whether both fingers of a gripper press on a body, towards each other."""
        return self.sim.contacts.grasped(side, body)


def smooth(fraction: float) -> float:
    """Minimum-jerk time scaling of [0, 1]."""
    s = min(max(fraction, 0.0), 1.0)
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


def bump(fraction: float) -> float:
    """Smooth rise from 0 to 1 at the middle of [0, 1], and back to 0, at rest at both ends."""
    return 16.0 * (fraction * (1.0 - fraction)) ** 2


def freedom_at(speed: float) -> float:
    """Freedom, 0 to 1, of a motion that a script leads at a speed in m/s."""
    return min(1.0, (speed / SPEED) ** 2)


def down(
    x: float,
    y: float,
    z: float,
    *,
    yaw: float = 0.0,
    tilt: float = 0.0,
) -> SE3:
    """Tool pose that points down: fingers open along y at yaw 0, camera in front.

    Args:
        x: Position in the table frame, in metres.
        y: Position in the table frame, in metres.
        z: Height of the tool centre point above the table top, in metres.
        yaw: Turn about the vertical, in radians.
        tilt: Turn about the axis in which the fingers open, in radians; positive tilts the gripper
            back, so that the fingertips point away from the robot.
    """
    turn = (
        SE3.about((0, 0, 1), yaw)
        @ SE3.about((1, 0, 0), math.pi)
        @ SE3.about((0, 1, 0), tilt)
    )
    return SE3(turn.rotation, np.array([x, y, z]))


def nearest_turn(
    yaw: float,
    period: float,
    around: float = 0.0,
) -> float:
    """The angle equal to `yaw` modulo `period` (radians) that is nearest to `around`."""
    return around + (yaw - around + period / 2) % period - period / 2


def wait(steps: int) -> Script:
    """Stay for some control steps."""
    for _ in range(steps):
        yield


def wait_until(condition: Callable[[], bool], max_steps: int) -> Script:
    """Stay until a condition holds, at most `max_steps` control steps."""
    for _ in range(max_steps):
        if condition():
            return
        yield


def together(*scripts: Script) -> Script:
    """Run scripts side by side until all have ended."""
    running = list(scripts)
    while running:
        still: list[Script] = []
        for script in running:
            try:
                next(script)
            except StopIteration:
                continue
            still.append(script)
        running = still
        if running:
            yield


def follow(
    arms: Arms,
    path: Callable[[float], Mapping[Side, SE3]],
    seconds: float,
    *,
    freedom: float | None = None,
) -> Script:
    """Lead the tools along a path, with smooth timing.

    Args:
        arms: The arms to move.
        path: Tool poses at a fraction in [0, 1].
        seconds: How long it takes in the plain script.
        freedom: How far a variety may change the timing, 0 to 1; if not given, that of careful
            motions.
    """
    seconds /= arms.variety.pace(freedom_at(CAREFUL) if freedom is None else freedom)
    steps = max(1, math.ceil(seconds / CONTROL_STEP))
    for number in range(1, steps + 1):
        arms.targets.update(path(smooth(number / steps)))
        yield


def move(
    arms: Arms,
    goals: Mapping[Side, SE3],
    *,
    speed: float = SPEED,
    turn_speed: float = TURN_SPEED,
    tolerance: float = ARRIVED,
    arrive: bool = True,
    freedom: float | None = None,
) -> Script:
    """Move tools along straight lines, arriving together; a variety bends long and fast ones.

    Args:
        arms: The arms to move.
        goals: Tool pose for each side that moves.
        speed: Mean speed in m/s of the tool with the longest way.
        turn_speed: Mean angular speed in rad/s of the tool with the largest turn.
        tolerance: Distance in metres at which a tool has arrived.
        arrive: Whether to wait for the tools themselves; otherwise only for their targets.
        freedom: How far a variety may change the motion, 0 to 1; if not given, its speed decides.
    """
    freedom = freedom_at(speed) if freedom is None else freedom
    yield from wait(arms.variety.pause_steps(goals, freedom))
    starts = {side: arms.targets[side] for side in goals}
    spans = [starts[side].distance(goal) for side, goal in goals.items()]
    seconds = max(max(length / speed, angle / turn_speed) for length, angle in spans)
    lines = {
        side: line_to(arms, starts[side], goal, freedom) for side, goal in goals.items()
    }

    def path(fraction: float) -> dict[Side, SE3]:
        arms.freedom[[side.index for side in goals]] = freedom * bump(fraction)
        return {side: line(fraction) for side, line in lines.items()}

    yield from follow(
        arms,
        path,
        seconds,
        freedom=freedom,
    )
    if arrive:
        steps = MAX_ARRIVAL_STEPS + arms.latency
        yield from wait_until(lambda: arrived(arms, goals, tolerance), steps)


def line_to(
    arms: Arms, start: SE3, goal: SE3, freedom: float
) -> Callable[[float], SE3]:
    """Poses at a fraction of the way, which is straight but for a variety's detour."""
    detour = arms.variety.detour(goal.translation - start.translation, freedom)
    return lambda fraction: start.interpolate(goal, fraction).moved(
        *(bump(fraction) * detour)
    )


def arrived(
    arms: Arms,
    goals: Mapping[Side, SE3],
    tolerance: float = ARRIVED,
) -> bool:
    """Whether the tools are at their goals."""
    errors = [arms.tcp_pose(side).distance(goal) for side, goal in goals.items()]
    return all(
        length <= tolerance and angle <= ARRIVED_TURN for length, angle in errors
    )


def grip(
    arms: Arms,
    *sides: Side,
    opening: float = CLOSED,
) -> Script:
    """Bring grippers to an opening and wait until their fingers have come to rest."""
    for side in sides:
        arms.openings[side.index] = opening
    gripper = arms.sim.robot.gripper
    yield from wait(2 + gripper.hold_steps + arms.latency)
    last = np.array([arms.opening(side) for side in sides])
    for _ in range(int(GRIP_TIME * gripper.closing_steps)):
        yield
        now = np.array([arms.opening(side) for side in sides])
        if np.abs(now - last).max() < AT_REST:
            return
        last = now


def release(
    arms: Arms,
    *sides: Side,
    opening: float = OPEN,
) -> Script:
    """Open grippers and wait until they are open."""
    yield from grip(arms, *sides, opening=opening)
