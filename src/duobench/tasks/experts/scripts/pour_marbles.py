"""Pour-Marbles: one arm holds the empty cup, the other pours into it.

Both grippers come from ahead and outside, at right angles to each other: there the wrists are far
from their limits. The pouring one turns its cup about the axis in which its fingers open, so that
it rises over the cup and ends behind it; the holding one keeps low, out of its way. The lip of the
pouring cup stays over the other's mouth, on the near side, from which the marbles fly to the
middle.
"""

import math

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.tasks.experts.handling import tool_for
from duobench.tasks.experts.motion import (
    CAREFUL,
    Arms,
    Script,
    bump,
    follow,
    grip,
    move,
    release,
    together,
    wait_until,
)
from duobench.world.objects.cup import HEIGHT, INNER_RADIUS

_GRASP_HEIGHT = 0.032
"""Height of the pads on a cup, in metres above its underside."""
_SHORT = 0.003
"""How far the tool centre point stays short of the cup's axis, in metres: at 1 mm the cup rubs
against the finger linkage, at 5 mm it turns in the pads by 10 degrees."""
HOLD_TILT = math.radians(59.0)
POUR_TILT = math.radians(50.0)
"""How far the grippers are from the vertical when they grasp, in radians. The holding one leans out
of the way of the pouring cup; leaning further, wrists come near their limits."""
_COMING_TILT = math.radians(30.0)
"""How far they are from there when they come: the elbow swings less on a way so far aside."""
_POUR_ANGLE = math.radians(106.0)
_POUR_SECONDS = 3.2
_RIGHT_SECONDS = 1.9
"""How long the cup takes to pour, and to turn upright again, in seconds; turned upright in 1.3 s,
it slips further in the pads, and by 30 degrees where they hold it half a millimetre less deep."""
_LIP_CLEARANCE = 0.040
"""Height of the pouring lip above the other cup's rim, in metres: the grippers stay 15 mm apart."""
_LIP_REACH = 0.034
"""How far the pouring lip stays short of the middle of the mouth, in metres: the marbles fly about
as far until they fall through the mouth, so they fall through its middle, within 20 mm of it."""
_MEETING = (0.50, 0.0, 0.09)
"""Position of the holding cup's underside while it waits for the marbles."""
_ABOVE = 0.08
"""Height in metres from which a cup is set down."""
_RISE = 0.07
"""How far the poured cup rises on its way back, in metres: its lip stays above the other cup."""


def script(arms: Arms) -> Script:
    """Take both cups, pour, put both back."""
    source = next(s for s in Side if _marbles_in(arms, s) > 0)
    hold = source.other
    yield from together(
        take(arms, hold, tilt=HOLD_TILT), take(arms, source, tilt=POUR_TILT)
    )
    meeting = SE3.at(*_MEETING)
    meet = {hold: meeting, source: _pouring(source, meeting, 0.0)}
    tools = {
        side: tool_for(arms, side, _cup(side), pose) for side, pose in meet.items()
    }
    yield from move(arms, tools, speed=CAREFUL)
    yield from pour(arms, source, meeting)
    yield from together(
        bring_back(arms, source), put_back(arms, hold, square(arms, hold))
    )


def pour(
    arms: Arms,
    source: Side,
    target: SE3,
) -> Script:
    """Pour all marbles from the cup in an arm into the one at a pose."""
    cup_from_tool = arms.sim.pose(_cup(source)).inverse() @ arms.tcp_pose(source)

    def turn(fraction: float) -> dict[Side, SE3]:
        return {
            source: _pouring(source, target, fraction * _POUR_ANGLE) @ cup_from_tool
        }

    yield from move(arms, turn(0.0), speed=CAREFUL)
    yield from follow(arms, turn, _POUR_SECONDS)
    yield from wait_until(lambda: _marbles_in(arms, source) == 0, 60)


def turn_upright(arms: Arms, side: Side) -> Script:
    """Turn the poured cup in an arm upright, on its way home."""
    poured, home = arms.targets[side], square(arms, side).moved(z=_ABOVE)
    upright = tool_for(arms, side, _cup(side), home)

    def turn(fraction: float) -> dict[Side, SE3]:
        return {
            side: poured.interpolate(upright, fraction).moved(z=_RISE * bump(fraction))
        }

    yield from follow(arms, turn, _RIGHT_SECONDS)


def bring_back(arms: Arms, side: Side) -> Script:
    """Turn the poured cup in an arm upright, and put it back."""
    yield from turn_upright(arms, side)
    yield from put_back(arms, side, square(arms, side))


def put_back(
    arms: Arms,
    side: Side,
    cup: SE3,
) -> Script:
    """Set the cup in an arm down at a pose, let go, and move away."""
    # It has turned a little in its gripper, and would come down on an edge.
    tool = tool_for(arms, side, _cup(side), cup)
    yield from move(
        arms,
        {side: tool.moved(z=_ABOVE)},
        speed=0.3,
        tolerance=0.01,
    )
    yield from move(arms, {side: tool.moved(z=0.002)}, speed=0.2)
    yield from release(arms, side)
    away = tool @ SE3.at(z=-0.10)
    yield from move(
        arms,
        {side: away},
        speed=0.3,
        arrive=False,
    )


def _cup(side: Side) -> str:
    return f"{side}_cup"


def square(arms: Arms, side: Side) -> SE3:
    """The middle of a square, where its cup goes back to; some start near its edge."""
    return SE3.at(*arms.sim.position(f"{side}_square"))


def _marbles_in(arms: Arms, side: Side) -> int:
    """Number of marbles nearer to a cup's axis than its wall."""
    cup = arms.sim.pose(_cup(side)).inverse()
    names = [name for name in arms.sim.props if name.startswith("marble")]
    local = cup.apply(np.array([arms.sim.position(name) for name in names]))
    within = np.hypot(local[:, 0], local[:, 1]) < INNER_RADIUS
    return int((within & (local[:, 2] > 0) & (local[:, 2] < HEIGHT)).sum())


def _inward(side: Side) -> np.ndarray:
    """Horizontal direction (3,) from an arm's own side, ahead, to the middle of the robot."""
    return np.array([-1.0, -side.sign, 0.0]) / math.sqrt(2.0)


def _grasp(
    arms: Arms,
    side: Side,
    tilt: float,
) -> SE3:
    """From ahead and outside, the fingers on two opposite walls, the camera on the upper side."""
    inward, up = _inward(side), np.array([0.0, 0.0, 1.0])
    approach = math.sin(tilt) * inward - math.cos(tilt) * up
    camera = math.cos(tilt) * inward + math.sin(tilt) * up
    rotation = np.column_stack([camera, np.cross(approach, camera), approach])
    middle = arms.sim.position(_cup(side)) + _GRASP_HEIGHT * up
    return SE3(rotation, middle - (_SHORT + arms.deeper) * approach)


def take(
    arms: Arms,
    side: Side,
    *,
    tilt: float = POUR_TILT,
) -> Script:
    """Grasp the cup of an arm's own side, `tilt` radians from the vertical, and raise it."""
    grasp = _grasp(arms, side, tilt)
    away = _grasp(arms, side, _COMING_TILT) @ SE3.at(z=-0.12)
    yield from move(arms, {side: away}, tolerance=0.015)
    yield from move(arms, {side: grasp}, speed=0.22)
    yield from grip(arms, side)
    yield from move(arms, {side: grasp.moved(z=0.06)}, speed=0.2)


def _pouring(
    side: Side,
    other: SE3,
    angle: float,
) -> SE3:
    """Pose of the pouring cup, tilted by `angle` about its lip over the other cup's mouth."""
    inward, up = _inward(side), np.array([0.0, 0.0, 1.0])
    rotation = SE3.about(np.cross(up, inward), angle).rotation
    # Upright, the lip waits short of the mouth; tilted, it reaches over its near half.
    reach = -_LIP_REACH - 2.2 * INNER_RADIUS * max(
        0.0, 1.0 - angle / math.radians(70.0)
    )
    lip = other.translation + reach * inward + (HEIGHT + _LIP_CLEARANCE) * up
    return SE3(rotation, lip - rotation @ (INNER_RADIUS * inward + HEIGHT * up))
