"""Handover of a bar by experts: one arm holds it by one end, the other takes the free end.

The bar's long axis is the x axis of its body. While it is handed over, the bar and both tools lie
in one upright plane across the table, so that both grippers clasp the same two faces of the bar.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from duobench.core.spatial import (
    SE3,
    dot,
    length,
    product,
)
from duobench.core.types import Array, Side
from duobench.tasks.experts.handling import pick, tool_for
from duobench.tasks.experts.motion import (
    CAREFUL,
    NEAR,
    Arms,
    Script,
    down,
    grip,
    move,
    nearest_turn,
    release,
    wait,
)

_FIRM_GRIP_STEPS = 4
"""Control steps in which both arms hold the bar before one lets go."""
_ALONG = 0.10
"""Distance in metres from which a tool approaches the bar along its axis, and of its retreat."""
_UPRIGHT_SINE = 1e-6
_LIFT = 0.10
"""Height in metres to which the giver lifts."""
_OUTWARDS = math.radians(15)
"""Turn in radians of the giver's camera from the arm's own direction, away from the other arm,
about which every yaw of a lying bar is reached without the last joint's stop."""
_MOST_INWARDS = math.radians(45)
"""Largest turn in radians of the giver's camera towards the other arm at the end of the lift: from
there it is the shorter turn outwards, to where the camera looks when the bar is handed over."""
CAMERA_YAW = math.radians(45)
"""Turn in radians of the camera of a hand that holds a bar lengthwise and points down, away from
the other arm: well off the last joint's stop, and not far from how the bar was received."""


def tool(
    position: ArrayLike,
    *,
    along: ArrayLike,
    camera: ArrayLike,
) -> SE3:
    """Tool pose at a position in the table frame that points `along`.

    Args:
        position: Tool centre point (3,) in metres.
        along: Direction (3,) out of the gripper.
        camera: Direction (3,) of the wrist camera, seen from the tool axis; its part along the tool
            axis is ignored. The fingers open at right angles to both.
    """
    z = np.asarray(along, dtype=np.float64)
    z = z / length(z)
    x = np.asarray(camera, dtype=np.float64)
    x = x - dot(x, z) * z
    x = x / length(x)
    return SE3(np.column_stack([x, np.cross(z, x), z]), np.asarray(position))


def hanging(
    arms: Arms,
    side: Side,
    body: str,
) -> SE3:
    """Pose of a bar that is held lengthwise, turned as little as possible so that it hangs down.

    Its position is the one that it has now.
    """
    pose = arms.sim.pose(body)
    axis = pose.rotation[:, 0]
    end_in_hand = (
        -np.copysign(1.0, dot(axis, arms.tcp_pose(side).rotation[:, 2])) * axis
    )
    turn = np.cross(end_in_hand, (0.0, 0.0, 1.0))
    sine = length(turn)
    if sine < _UPRIGHT_SINE:
        return pose
    upright = SE3.about(turn, math.atan2(sine, end_in_hand[2]))
    return SE3(product(upright.rotation, pose.rotation), pose.translation)


def turn_to_camera(
    arms: Arms,
    side: Side,
    body: str,
    pose: SE3,
) -> float:
    """Turn about the vertical, in radians, that brings the camera to `CAMERA_YAW`.

    Args:
        arms: The arms.
        side: Which arm holds the body.
        body: The body.
        pose: Pose of the body at which its hand points down.
    """
    camera = tool_for(arms, side, body, pose).rotation[:, 0]
    return side.sign * CAMERA_YAW - math.atan2(camera[1], camera[0])


@dataclass(frozen=True, kw_only=True, slots=True)
class Bar:
    """A bar on its way from one arm to the other."""

    body: str
    giver: Side
    """The arm that picks it up."""
    grip: float
    """Grasp of the giver: distance from the bar's centre, towards the giver's camera."""
    height: float
    """Height of the tool centre point when the giver clasps the lying bar, in metres."""
    tilt: float = 0.0
    """Tilt in radians of the giver's hand when it clasps the lying bar, towards its camera."""
    freedom: float = 1.0
    """Share of a variety's differences with which the giver still holds the bar firmly."""

    def free_end(self, arms: Arms) -> Array:
        """Direction (3,) of the bar's axis, out of the giver's hand."""
        axis = arms.sim.rotation(self.body)[:, 0]
        return (
            -np.copysign(1.0, dot(axis, arms.tcp_pose(self.giver).rotation[:, 0]))
            * axis
        )


def pick_bar(arms: Arms, bar: Bar) -> Script:
    """Pick up the lying bar by the end that is nearer to the giver's side of the hand."""
    giver = bar.giver
    while not arms.grasps(giver, bar.body):
        pose = arms.sim.pose(bar.body)
        x, y, _ = pose.translation - arms.sim.robot.shoulders[giver]
        yaw = nearest_turn(pose.yaw, math.pi, math.atan2(y, x) + giver.sign * _OUTWARDS)
        x, y, _ = pose.translation + bar.grip * np.array(
            [math.cos(yaw), math.sin(yaw), 0.0]
        )
        grasp = down(
            x,
            y,
            bar.height,
            yaw=yaw,
            tilt=bar.tilt,
        )
        yield from pick(
            arms,
            giver,
            grasp,
            lift=0,
            freedom=bar.freedom,
        )
        excess = max(0.0, -giver.sign * yaw - _MOST_INWARDS)
        turned = (
            SE3.about((0, 0, 1), giver.sign * excess).rotation
            @ arms.targets[giver].rotation
        )
        lifted = SE3(turned, arms.targets[giver].translation).moved(z=_LIFT)
        yield from move(
            arms,
            {giver: lifted},
            speed=0.3,
            arrive=False,
        )


def present(
    bar: Bar,
    centre: ArrayLike,
    rise: float,
    lean: float = 0.0,
) -> SE3:
    """Tool pose at which the giver holds the bar's centre at a position, its free end across.

    Args:
        bar: The bar.
        centre: Position (3,) of the bar's centre.
        rise: Angle of the free end above the horizontal, in radians.
        lean: Angle in radians by which the plane of bar and tools leans away from the robot.
    """
    s = bar.giver.other.sign
    leaning = SE3.about((0, 1, 0), lean).rotation
    free = leaning @ (0.0, s * math.cos(rise), math.sin(rise))
    along = leaning @ (0.0, s * math.sin(rise), -math.cos(rise))
    upright = tool(np.asarray(centre) - bar.grip * free, along=along, camera=-free)
    return upright @ SE3.about((0, 1, 0), bar.tilt)


def receive_pose(
    arms: Arms,
    bar: Bar,
    grip_at: float,
    slant: float,
) -> SE3:
    """Tool pose at which the receiver clasps the free end, from where the bar really is.

    Args:
        arms: The arms.
        bar: The bar.
        grip_at: Where it clasps: distance from the bar's centre towards the free end, in metres.
        slant: Angle in radians between the tool's axis and the bar's; zero grips it lengthwise, a
            positive one comes from above.
    """
    free = bar.free_end(arms)
    opening = arms.tcp_pose(bar.giver).rotation[:, 1]
    normal = opening - dot(opening, free) * free
    upwards = np.cross(normal, free)
    upwards *= np.sign(upwards[2])
    along = -math.cos(slant) * free - math.sin(slant) * upwards
    camera = math.sin(slant) * free - math.cos(slant) * upwards
    position = arms.sim.position(bar.body) + grip_at * free
    return tool(position, along=along, camera=camera)


def clasp(
    arms: Arms,
    side: Side,
    pose: SE3,
) -> Script:
    """Come along the tool's axis, fingers open, and close them."""
    yield from release(arms, side)
    yield from move(arms, {side: pose @ SE3.at(z=-_ALONG)}, tolerance=NEAR)
    yield from move(arms, {side: pose}, speed=CAREFUL)
    yield from grip(arms, side)
    yield from wait(_FIRM_GRIP_STEPS)


def let_go(arms: Arms, side: Side) -> Script:
    """Open the fingers and retreat along the tool's axis."""
    yield from release(arms, side)
    back = arms.targets[side] @ SE3.at(z=-_ALONG)
    yield from move(
        arms,
        {side: back},
        speed=0.35,
        arrive=False,
    )
