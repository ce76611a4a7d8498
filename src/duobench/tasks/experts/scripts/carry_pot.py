"""Carry-Pot: both arms take a handle each and carry the pot as one rigid body."""

from collections.abc import Mapping
from dataclasses import dataclass

from duobench.core.spatial import SE3
from duobench.core.types import SIDES, Side
from duobench.tasks.experts.handling import carry, come_down
from duobench.tasks.experts.motion import (
    CAREFUL,
    Arms,
    Script,
    down,
    grip,
    move,
    release,
    wait,
)
from duobench.world.objects.pot import (
    HANDLE_OFFSET,
    HANDLE_Z,
    HEIGHT,
    PLATE,
)

_APPROACH = 0.10
"""Height in metres above the handles from which the tools come straight down."""
_APPROACH_SPEED = 0.38
"""Mean speed in m/s of the tools on their way there: the shoulders turn in time at any tempo."""
_OPENING = 0.45
"""Opening on the way down: wide enough for the bar, narrow enough for the gap to the wall."""
_LIFT = 0.06
_CLEARANCE = 0.04
"""Height in metres of the pot above the table, and above the plate, while it is carried."""
_LANDING_SPEED = 0.06
_BELOW = 0.01
"""How fast (m/s) the pot is lowered onto the plate, and how far below the plate's top, in metres,
it would be led if it did not touch it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class HandleGrasp:
    """How a gripper takes its handle, from above; the defaults are the expert's way."""

    height: float = 0.004
    """Height of the tool centre point above the bar in metres: near the middle of the pads."""
    along: float = 0.0
    """Place along the bar, from its middle, in metres along the pot's x axis."""
    yaw: float = 0.0
    """Turn against the pot, in radians."""
    tilt: float = 0.0
    """Lean of the gripper along the bar in radians, see `down`."""


PLAIN = HandleGrasp()


def script(arms: Arms) -> Script:
    """Carry the pot to the middle of the stove plate."""
    yield from lift(arms)
    x, y, _ = arms.sim.position("stove")
    yield from carry_over(arms, x, y)
    yield from land(arms)
    yield from let_go(arms)


def lift(arms: Arms) -> Script:
    """Take the pot by both handles, and lift it."""
    while not all(arms.grasps(side, _handle(side)) for side in SIDES):
        yield from grasp(arms)
    yield from carry(
        arms,
        "pot",
        arms.sim.pose("pot").moved(z=_LIFT),
        speed=0.15,
    )


def carry_over(
    arms: Arms, x: float, y: float, *sides: Side, height: float = _CLEARANCE
) -> Script:
    """Carry the pot to a place above the plate; its yaw does not change."""
    goal = _level(arms, x, y, height)
    yield from carry(
        arms,
        "pot",
        goal,
        *sides,
        speed=CAREFUL,
    )


def land(arms: Arms, *sides: Side) -> Script:
    """Lower the pot until it touches the plate; both arms hold it where none is given."""
    x, y, _ = arms.sim.position("pot")
    low = _level(arms, x, y, -_BELOW)
    for _ in carry(
        arms,
        "pot",
        low,
        *sides,
        speed=_LANDING_SPEED,
    ):
        if arms.sim.contacts.between("pot", "stove"):
            break
        yield
    # The servos lag behind: from here on they shall not press the pot down.
    arms.targets.update({side: arms.tcp_pose(side) for side in sides or SIDES})
    yield from wait(3)


def _level(
    arms: Arms,
    x: float,
    y: float,
    height: float,
) -> SE3:
    """Pose of the pot level above the plate, with its current yaw."""
    yaw = arms.sim.pose("pot").yaw
    return SE3.at(
        x,
        y,
        PLATE[2] + HEIGHT / 2 + height,
        yaw=yaw,
    )


def let_go(arms: Arms, *sides: Side) -> Script:
    """Open the grippers, of both arms where none is given, and move up."""
    sides = sides or SIDES
    yield from release(arms, *sides, opening=_OPENING)
    goals = {side: arms.targets[side].moved(z=_APPROACH) for side in sides}
    yield from move(arms, goals, arrive=False)


def grasp(
    arms: Arms, *sides: Side, hold: Mapping[Side, HandleGrasp] | None = None
) -> Script:
    """Close grippers around the handles, from above.

    Args:
        arms: The arms.
        sides: The arms that do so; both where none is given.
        hold: How each of them takes its handle, as the expert does where none is given.
    """
    sides, hold = sides or SIDES, hold or {}
    pot = arms.sim.pose("pot")
    grasps = {side: _grasp_pose(pot, side, hold.get(side, PLAIN)) for side in sides}
    yield from come_down(
        arms, grasps, opening=_OPENING, above=_APPROACH, speed=_APPROACH_SPEED
    )
    yield from grip(arms, *sides)


def _grasp_pose(
    pot: SE3,
    side: Side,
    hold: HandleGrasp,
) -> SE3:
    x, y, z = pot.apply((hold.along, side.sign * HANDLE_OFFSET, HANDLE_Z + hold.height))
    return down(
        x,
        y,
        z,
        yaw=pot.yaw + hold.yaw,
        tilt=hold.tilt,
    )


def _handle(side: Side) -> str:
    return f"pot/{side}_handle"
