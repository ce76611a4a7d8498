"""Join-Blocks: the right hand holds the dark bar ahead, the left one plugs in from behind it.

The hands lean apart, the front one forwards and the rear one back, so that both fit on bars that
are 75 mm long. What a hand holds is led by the pose of the bar, not of the tool: before every
insertion the target is corrected by the error that the bar really has.
"""

import math
from collections.abc import Mapping

from duobench.core.spatial import SE3
from duobench.core.types import SIDES, Side
from duobench.tasks.experts.handling import pick, tool_for
from duobench.tasks.experts.motion import (
    CAREFUL,
    Arms,
    Script,
    down,
    move,
    release,
    together,
    wait,
)
from duobench.world.objects.joint_blocks import (
    BAR,
    PEG_HEIGHT,
    PEG_LENGTH,
    WALL_PLATE,
)

_BARS = {Side.LEFT: "light_block", Side.RIGHT: "dark_block"}
_TILTS = {Side.LEFT: math.radians(20.0), Side.RIGHT: math.radians(-20.0)}
"""How far each hand leans back; much more is out of reach for a bar that lies close."""
_SHORT = 0.03
"""How much shorter than usual hands are, in metres, whose forearms would meet."""
_SHORT_TILTS = {Side.LEFT: math.radians(45.0), Side.RIGHT: math.radians(-20.0)}
"""How far these lean: at 20 degrees their forearms would be 17 mm in each other."""
_GRASP_X = {Side.LEFT: -0.012, Side.RIGHT: 0.0}
"""Grasp of each hand along its bar, in metres from the middle."""
_GRASP_HEIGHT = 0.026
"""Height of the tool above the table when it grasps, in metres."""
_FREEDOM = 0.3
"""Share of a variety's grasp offset at which the hands still fit beside each other."""
_MEETING_X = 0.565
"""Position of the middle of the dark bar while it waits for the light one, in metres."""
_APART = 0.03
"""Distance between peg tip and socket before an insertion, in metres."""
_TOUCHING = 0.0005
"""Gap that is left between faces that meet, in metres."""
_BEFORE_WALL = 0.012
"""Distance between the wall's peg and the socket before they meet, in metres."""
_SLOW = 0.05
_RETREAT = 0.10
"""Distance in metres that each hand backs out after letting go."""
_CORRECTIONS = 3


def script(arms: Arms) -> Script:
    """Take both bars, plug them together, push them onto the wall, let go of them."""
    yield from together(*(_take(arms, side) for side in Side))
    dark = SE3.at(_MEETING_X, 0.0, PEG_HEIGHT)
    light = dark.moved(x=-BAR[0] - PEG_LENGTH - _APART)
    yield from _lead(arms, {Side.RIGHT: dark, Side.LEFT: light}, speed=CAREFUL)
    yield from _correct(arms, {Side.RIGHT: dark, Side.LEFT: light})
    joined = dark.moved(x=-BAR[0] - _TOUCHING)
    yield from _lead(arms, {Side.LEFT: joined}, speed=_SLOW)
    to_wall = WALL_PLATE[0] / 2 + BAR[0] / 2 + _TOUCHING
    front = arms.sim.pose("wall") @ SE3.at(-to_wall, 0.0, PEG_HEIGHT)
    before = front.moved(x=-PEG_LENGTH - _BEFORE_WALL)
    for goal, speed in ((before, 0.10), (front, _SLOW)):
        both = {Side.RIGHT: goal, Side.LEFT: goal.moved(x=-BAR[0] - _TOUCHING)}
        yield from _lead(arms, both, speed=speed)
    yield from release(arms, *SIDES)
    away = {side: arms.targets[side] @ SE3.at(z=-_RETREAT) for side in SIDES}
    yield from move(
        arms,
        away,
        speed=CAREFUL,
        arrive=False,
    )


def _take(arms: Arms, side: Side) -> Script:
    pose = arms.sim.pose(_BARS[side])
    x, y, _ = pose.apply([_GRASP_X[side], 0.0, 0.0])
    grasp = down(
        x,
        y,
        _GRASP_HEIGHT,
        yaw=pose.yaw,
        tilt=(_SHORT_TILTS if arms.shorter > _SHORT else _TILTS)[side],
    )
    yield from pick(
        arms,
        side,
        grasp,
        above=0.10,
        lift=0.06,
        freedom=_FREEDOM,
    )


def _lead(
    arms: Arms,
    bars: Mapping[Side, SE3],
    *,
    speed: float,
) -> Script:
    """Move the held bars to poses in the table frame, along straight lines."""
    goals = {side: tool_for(arms, side, _BARS[side], bar) for side, bar in bars.items()}
    yield from move(
        arms,
        goals,
        speed=speed,
        turn_speed=0.6,
        tolerance=0.0015,
    )


def _correct(arms: Arms, bars: Mapping[Side, SE3]) -> Script:
    """Shift the tools by what their bars are still off, a few times."""
    for _ in range(_CORRECTIONS):
        for side, bar in bars.items():
            error = bar @ arms.sim.pose(_BARS[side]).inverse()
            arms.targets[side] = error @ arms.targets[side]
        yield from wait(8)
