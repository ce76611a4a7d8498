"""How sincere ways of the tasks of sequential handoff hand a bar over and put it down."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import Array, Side
from duobench.tasks.experts.handling import tool_for
from duobench.tasks.experts.handover import (
    CAMERA_YAW,
    Bar,
    clasp,
    hanging,
    let_go,
    pick_bar,
    present,
    receive_pose,
    tool,
    turn_to_camera,
)
from duobench.tasks.experts.motion import CAREFUL, NEAR, Arms, Script, move, release, together
from duobench.world.objects.blocks import CUBE_EDGE, LONG_BLOCK
from tests.ways.way import WayFailedError

PICKING_STEPS = 300
"""Control steps after which a hand gives up picking the bar up: it may be out of its reach."""
PADS_APART = 0.054
"""Least distance in metres along a bar between two tools that clasp it: pads reach 23 mm beyond the
tool point, are 22 mm wide, and come at an angle. Nearer, one hand pinches the other one's pad."""
FACING, MUCH = math.radians(75), 0.3
"""Turn in radians of the camera of a hand that leans, away from the other arm, and the lean from
which on a hand is turned there."""
IN_THE_AIR, SEEN = 0.10, 0.001
"""Height of a bar's lowest point above which hands have it, and how much higher than meant a bar
may be when it is let go, in metres."""
RETREAT = 0.10
"""How far a hand is drawn back, in metres."""
RARELY = {"slowly": 0.12, "trembling": 0.12}
"""How often a random way is slow, and how often it trembles."""
STILL_SPEED, STILL_TURN = 0.05, 1.0
"""Speeds in m/s and rad/s below which a person sees an object at rest: a block that leans on the
rim of a bowl trembles so fast in the model, by less than can be seen."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Meeting:
    """Where and how a bar goes from hand to hand."""

    bar: Bar
    """The bar, and how the giver holds it."""
    centre: tuple[float, float, float]
    """Where its centre is, in metres."""
    rise: float
    """Angle of its free end above the horizontal, in radians."""
    grip_at: float
    """Where the receiver clasps it: distance from the bar's centre towards the free end."""
    slant: float = 0.0
    """Angle in radians between the receiver's tool and the bar."""
    lean_away: float = 0.0
    """Angle in radians by which bar and hands lean away from the robot."""
    before: float = 0.0
    """How far short of the centre the giver stops on its way, in metres."""


def check(as_meant: bool) -> None:
    if not as_meant:
        raise WayFailedError


def hand_over(arms: Arms, meeting: Meeting) -> Script:
    body, giver, receiver = meeting.bar.body, meeting.bar.giver, meeting.bar.giver.other
    x, y, z = meeting.centre
    ready = tool(
        (x, y + 0.25 * receiver.sign, z + 0.10),
        along=(0.0, -1.0 * receiver.sign, -1.0),
        camera=(0.0, 1.0 * receiver.sign, -1.0),
    )
    picking = islice(pick_bar(arms, meeting.bar), PICKING_STEPS)
    yield from together((None for _ in picking), move(arms, {receiver: ready}, arrive=False))
    at = present(meeting.bar, meeting.centre, meeting.rise, meeting.lean_away)
    if meeting.before:
        yield from move(arms, {giver: at.moved(y=meeting.before * giver.sign)})
    yield from move(arms, {giver: at}, tolerance=NEAR, speed=CAREFUL)
    check(arms.sim.min_height(body) > IN_THE_AIR)
    clasped = receive_pose(arms, meeting.bar, meeting.grip_at, meeting.slant)
    yield from clasp(arms, receiver, clasped)
    yield from let_go(arms, giver)
    check(arms.sim.min_height(body) > IN_THE_AIR)


def leaning(arms: Arms, side: Side, body: str, lean: float) -> SE3:
    """Pose of a bar whose end in the hand leans outwards, to where the hand's camera looks, by
    an angle in radians from upright. Its position is the one that it has now.
    """
    standing = hanging(arms, side, body)
    facing = side.sign * (FACING - CAMERA_YAW) * min(1.0, lean / MUCH)
    turn = SE3.about((0, 0, 1), turn_to_camera(arms, side, body, standing) + facing)
    yaw = side.sign * CAMERA_YAW + facing
    outwards = SE3.about((-math.sin(yaw), math.cos(yaw), 0.0), lean)
    return SE3((outwards @ turn).rotation @ standing.rotation, standing.translation)


def low_end(pose: SE3) -> Array:
    """The middle of the lower end of a long block, but at the height of its lowest point (3,)."""
    axis = pose.rotation[:, 0]
    axis = -np.copysign(1.0, axis[2]) * axis
    low = abs(axis[2]) * LONG_BLOCK / 2 + np.abs(pose.rotation[2, 1:]).sum() * CUBE_EDGE / 2
    x, y, z = pose.translation
    return np.array([x + axis[0] * LONG_BLOCK / 2, y + axis[1] * LONG_BLOCK / 2, z - low])


def put_down(arms: Arms, side: Side, body: str, lean: float, spot: Array, *, low: float) -> Script:
    """Bring the lower end of a long block, so far from upright, to a spot (3,), let go there, and
    draw the hand back along itself.

    At a height of `low` metres a person sees that it is low enough to let go.
    """
    goal = leaning(arms, side, body, lean)
    goal = goal.moved(*(spot - low_end(goal)))
    for height, speed, tolerance in ((0.08, 0.4, NEAR), (0.02, CAREFUL, 0.004), (0.0, 0.06, 0.001)):
        pose = tool_for(arms, side, body, goal.moved(z=height))
        yield from move(arms, {side: pose}, speed=speed, tolerance=tolerance)
        check(arms.sim.contacts.gripper(side, body))
    check(arms.sim.min_height(body) < low + SEEN)
    yield from release(arms, side)
    back = arms.targets[side] @ SE3.at(z=-RETREAT)
    yield from move(arms, {side: back}, speed=0.35, arrive=False)


def at_rest(speed: tuple[float, float]) -> bool:
    return speed[0] < STILL_SPEED and speed[1] < STILL_TURN


def random_grasps(
    rng: np.random.Generator, bar: Bar, reach: float, left: float = 0.0
) -> dict[str, Any]:
    """A giver's grasp, now and then the left arm's, and where the receiver clasps: anywhere that
    two hands have room, its tool at most `reach` metres from the bar's centre.
    """
    grip = rng.uniform(0.012, 0.040)
    bar = replace(
        bar,
        giver=Side.LEFT if rng.random() < left else bar.giver,
        grip=grip,
        height=bar.height + rng.uniform(-0.010, 0.006),
        tilt=rng.uniform(-0.2, 0.3),
    )
    return {"bar": bar, "grip_at": rng.uniform(max(PADS_APART - grip, 0.010), reach)}
