"""Objects in the hand: picked up, carried, put down; the second half of the experts' vocabulary."""

import math
from collections.abc import Callable, Mapping

from duobench.core.spatial import SE3
from duobench.core.types import SIDES, Side
from duobench.tasks.experts.motion import (
    CAREFUL,
    NEAR,
    OPEN,
    SPEED,
    TURN_SPEED,
    Arms,
    Script,
    down,
    follow,
    freedom_at,
    grip,
    line_to,
    move,
    nearest_turn,
    release,
    wait_until,
)

LET_GO = 0.75
"""Opening that frees a cube and still fits between walls around it."""


def pick(
    arms: Arms,
    side: Side,
    grasp: SE3,
    *,
    above: float = 0.10,
    lift: float = 0.10,
    speed: float = SPEED,
    freedom: float = 1.0,
) -> Script:
    """Come from above, close on an object, lift it.

    Args:
        arms: The arms.
        side: Which arm picks.
        grasp: Tool pose at which the fingers close.
        above: Height in metres from which the tool comes straight down.
        lift: Height in metres by which it lifts.
        speed: Mean speed in m/s of the approach.
        freedom: Share of a variety's grasp offset that still holds the object.
    """
    grasp = grasp @ arms.variety.grasp_offset(freedom)
    arms.openings[side.index] = OPEN
    yield from move(arms, {side: grasp.moved(z=above)}, speed=speed, tolerance=NEAR)
    yield from move(arms, {side: grasp}, speed=CAREFUL)
    yield from grip(arms, side)
    yield from move(arms, {side: grasp.moved(z=lift)}, speed=0.3, arrive=False)


def pick_cube(arms: Arms, side: Side, cube: str, height: float, *, tilt: float = 0.0) -> Script:
    """Pick up a lying cube by two of its sides, again until it is in the hand.

    Args:
        arms: The arms.
        side: Which arm picks.
        cube: Body of the cube.
        height: Height of the tool centre point when the fingers close, in metres.
        tilt: Tilt of the gripper, see `down`.
    """
    while not arms.grasps(side, cube):
        pose = arms.sim.pose(cube)
        x, y, _ = pose.translation
        yaw = nearest_turn(pose.yaw, math.pi / 2)
        yield from pick(arms, side, down(x, y, height, yaw=yaw, tilt=tilt))


def come_down(
    arms: Arms,
    grasps: Mapping[Side, SE3],
    *,
    opening: float,
    above: float,
    speed: float = SPEED,
) -> Script:
    """Bring open grippers around what they will grasp, from above.

    Args:
        arms: The arms.
        grasps: Tool poses at which the fingers will close.
        opening: Opening on the way down.
        above: Height in metres from which the tools come straight down.
        speed: Mean speed in m/s of the tools on their way there.
    """
    grasps = {side: grasp @ arms.variety.grasp_offset(1.0) for side, grasp in grasps.items()}
    for side in grasps:
        arms.openings[side.index] = opening
    start = {side: grasp.moved(z=above) for side, grasp in grasps.items()}
    yield from move(arms, start, speed=speed, tolerance=NEAR)
    yield from move(arms, grasps, speed=CAREFUL)


def tool_for(arms: Arms, side: Side, body: str, goal: SE3) -> SE3:
    """Tool pose at which a body, as it lies in the hand now, has a pose in the table frame."""
    return goal @ arms.sim.pose(body).inverse() @ arms.tcp_pose(side)


def place(
    arms: Arms,
    side: Side,
    goal: SE3,
    *,
    above: float = 0.08,
    retreat: float = 0.08,
    speed: float = SPEED,
) -> Script:
    """Carry to above a goal, lower, let go, retreat upwards."""
    yield from move(arms, {side: goal.moved(z=above)}, speed=speed, tolerance=NEAR)
    yield from move(arms, {side: goal}, speed=CAREFUL)
    yield from release(arms, side)
    yield from move(arms, {side: goal.moved(z=retreat)}, speed=speed, arrive=False)


def carry(
    arms: Arms,
    body: str,
    goal: SE3,
    *sides: Side,
    speed: float = SPEED,
) -> Script:
    """Move a grasped body along a line as `move` does, with the tools rigid to it.

    It does not wait to arrive.

    Args:
        arms: The arms.
        body: Body that the grippers hold.
        goal: Pose of the body in the table frame.
        sides: The arms that hold it; both where none is given.
        speed: Mean speed of the body in m/s.
    """
    start = arms.sim.pose(body)
    grasps = {side: start.inverse() @ arms.targets[side] for side in sides or SIDES}
    length, angle = start.distance(goal)
    freedom = freedom_at(speed)
    line = line_to(arms, start, goal, freedom)

    def path(fraction: float) -> dict[Side, SE3]:
        world_from_body = line(fraction)
        return {side: world_from_body @ grasp for side, grasp in grasps.items()}

    yield from follow(arms, path, max(length / speed, angle / TURN_SPEED), freedom=freedom)


def put_in(
    arms: Arms,
    side: Side,
    fetch: Script,
    is_open: Callable[[], bool],
    go_in: Script,
    *,
    max_steps: int,
) -> Script:
    """Fetch an object, wait until what it goes into is open, and let it go in there.

    Args:
        arms: The arms.
        side: Which arm puts it in; the other one opens.
        fetch: Picks the object up.
        is_open: Whether it can go in.
        go_in: Brings it in.
        max_steps: Control steps after which it goes in at any rate.
    """
    yield from fetch
    yield from wait_until(is_open, max_steps)
    yield from go_in
    yield from release(arms, side, opening=LET_GO)
