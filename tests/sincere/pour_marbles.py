"""Sincere ways in pour_marbles: other heights, angles, goes, grasps and releases."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from duobench.experts.handling import tool_for
from duobench.experts.motion import (
    CAREFUL,
    NEAR,
    Arms,
    Script,
    bump,
    down,
    follow,
    grip,
    move,
    release,
    together,
    wait,
    wait_until,
)
from duobench.objects.cup import HEIGHT, INNER_RADIUS
from duobench.scene.naming import TABLE
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.tasks.pour_marbles import CUPS, HALF_SQUARE, MARBLES, SQUARES
from duobench.types import SIDES, Side
from tests.sincere.sincere import Way, left_alone, numbers, tilt

HOLD_LEAN, POUR_LEAN = math.radians(62.0), math.radians(60.0)
"""How far the hands are from the vertical when they grasp the target and the source, in radians."""
SHORT = 0.003
"""How far the tool stays short of the cup's axis, in metres."""
LIP_CLEARANCE = 0.040
RISE, ABOVE = 0.07, 0.08
"""How far the poured cup is raised on its way back, and from where it is set down, in metres."""
UP = np.array([0.0, 0.0, 1.0])
MAX_TILT = math.radians(15.0)
"""How far a cup leans at most that a person would call upright, in radians."""


FIST_HEIGHT = 0.035
"""Height of the tool in metres at which closed fingers push a cup along the table."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Pouring:
    """How the marbles are poured; the defaults are about the expert's way."""

    height: float = 0.09
    """Height of the target cup's underside above the table, in metres."""
    angle: float = math.radians(106.0)
    """How far the source cup is tilted, in radians."""
    goes: int = 1
    """In how many goes the marbles are poured."""
    seconds: float = 3.2
    """How long a go takes."""
    grasps: tuple[float, float] = (0.032, 0.032)
    """Where source and target cup are grasped, in metres above their undersides."""
    drop: float = 0.002
    """Height of a cup's lowest point above the table when it is let go, in metres."""
    place: tuple[float, float] = (0.0, 0.0)
    """Where the cups are put back, from the middles of their squares, in metres."""
    ahead: float = 0.0
    """How far the hands come from ahead, and not from aside, in radians."""
    reach: float = 0.034
    """How far the pouring lip stays short of the middle of the mouth, in metres."""


def pour(arms: Arms, how: Pouring) -> Script:
    """Take both cups, pour in the air, put both back."""
    source = max(SIDES, key=lambda side: _marbles_in(arms.sim, side))
    hold = source.other
    from_source, from_target = how.grasps
    yield from together(
        _take(arms, source, POUR_LEAN, from_source, how),
        _take(arms, hold, HOLD_LEAN, from_target, how),
    )
    x, y, _ = 0.5 * (arms.sim.position(SQUARES[source]) + arms.sim.position(SQUARES[hold]))
    meeting = SE3.at(x, y, how.height)
    meet = {hold: meeting, source: _over(source, meeting, 0.0, how)}
    tools = {side: tool_for(arms, side, CUPS[side], pose) for side, pose in meet.items()}
    yield from move(arms, tools, speed=CAREFUL)
    cup_from_tool = arms.sim.pose(CUPS[source]).inverse() @ arms.tcp_pose(source)

    def turn(start: float, end: float) -> Script:
        def at(fraction: float) -> dict[Side, SE3]:
            angle = (start + (end - start) * fraction) * how.angle
            return {source: _over(source, meeting, angle, how) @ cup_from_tool}

        return follow(arms, at, how.seconds * max(0.3, abs(end - start)))

    yield from move(arms, {source: _over(source, meeting, 0.0, how) @ cup_from_tool})
    if how.goes > 1:
        yield from turn(0.0, 0.85)
        yield from turn(0.85, 0.5)
        yield from wait(15)
        yield from turn(0.5, 1.0)
    else:
        yield from turn(0.0, 1.0)
    yield from wait_until(lambda: _marbles_in(arms.sim, source) == 0, 60)
    yield from wait(10)
    yield from together(_turn_upright(arms, source, how), _put_back(arms, hold, how))
    yield from _put_back(arms, source, how)


def _inward(side: Side, how: Pouring) -> np.ndarray:
    """Horizontal direction (3,) in which a hand comes to its cup."""
    return np.array([-math.sin(how.ahead), -side.sign * math.cos(how.ahead), 0.0])


def _take(arms: Arms, side: Side, lean: float, height: float, how: Pouring) -> Script:
    """Grasp a cup from outside, `lean` radians from the vertical, and raise it."""
    ahead = _inward(side, how)
    approach = math.sin(lean) * ahead - math.cos(lean) * UP
    camera = math.cos(lean) * ahead + math.sin(lean) * UP
    rotation = np.column_stack([camera, np.cross(approach, camera), approach])
    grasp = SE3(rotation, arms.sim.position(CUPS[side]) + height * UP - SHORT * approach)
    yield from move(arms, {side: grasp @ SE3.at(z=-0.12)}, tolerance=0.015)
    yield from move(arms, {side: grasp}, speed=0.22)
    yield from grip(arms, side)
    yield from move(arms, {side: grasp.moved(z=0.06)}, speed=0.2)


def _over(side: Side, target: SE3, angle: float, how: Pouring) -> SE3:
    """Pose of the pouring cup, tilted by `angle` about its lip over the other cup's mouth."""
    ahead = _inward(side, how)
    rotation = SE3.about(np.cross(UP, ahead), angle).rotation
    reach = -how.reach - 2.2 * INNER_RADIUS * max(0.0, 1.0 - angle / math.radians(70.0))
    lip = target.translation + reach * ahead + (HEIGHT + LIP_CLEARANCE) * UP
    return SE3(rotation, lip - rotation @ (INNER_RADIUS * ahead + HEIGHT * UP))


def _home(arms: Arms, side: Side, how: Pouring) -> SE3:
    x, y, z = arms.sim.position(SQUARES[side])
    return SE3.at(x + how.place[0], y + how.place[1], z)


def _turn_upright(arms: Arms, side: Side, how: Pouring) -> Script:
    poured = arms.targets[side]
    upright = tool_for(arms, side, CUPS[side], _home(arms, side, how).moved(z=ABOVE))
    yield from follow(
        arms,
        lambda f: {side: poured.interpolate(upright, f).moved(z=RISE * bump(f))},
        1.9,
    )


def _put_back(arms: Arms, side: Side, how: Pouring) -> Script:
    cup = CUPS[side]
    tool = tool_for(arms, side, cup, _home(arms, side, how).moved(z=ABOVE))
    yield from move(arms, {side: tool}, speed=0.3, tolerance=NEAR)
    yield from move(arms, {side: tool.moved(z=0.02 - ABOVE)}, speed=0.2)
    for _ in range(2):
        lower = how.drop - arms.sim.min_height(cup)
        goal = SE3(arms.targets[side].rotation, arms.tcp_pose(side).translation + lower * UP)
        yield from move(arms, {side: goal}, speed=0.1)
    yield from release(arms, side)
    away = arms.targets[side] @ SE3.at(z=-0.10)
    yield from move(arms, {side: away}, speed=0.3, arrive=False)


def push_home(arms: Arms, how: Pouring) -> Script:
    """Pour, put both cups down before their squares, and push them onto these with closed fists."""
    yield from pour(arms, how)
    for side in SIDES:
        yield from grip(arms, side, opening=0.0)
        x, y, _ = arms.sim.position(CUPS[side])
        behind = down(x - 0.09, y, FIST_HEIGHT, yaw=side.sign * math.pi / 2)
        yield from move(arms, {side: behind.moved(z=0.12)}, speed=0.4, tolerance=NEAR)
        yield from move(arms, {side: behind}, speed=0.2)

        def is_home(side: Side = side) -> bool:
            return arms.sim.relative_position(CUPS[side], SQUARES[side])[0] > -HALF_SQUARE / 2

        for _ in move(arms, {side: behind.moved(x=0.12)}, speed=0.08):
            yield
            if is_home():
                break
        arms.targets[side] = arms.tcp_pose(side)
        yield from move(arms, {side: arms.targets[side].moved(x=-0.05)}, speed=0.2)
        yield from move(arms, {side: arms.targets[side].moved(z=0.12)}, speed=0.3, arrive=False)


def _marbles_in(sim: Simulation, side: Side) -> int:
    """How many marbles are between a cup's walls, below its rim."""
    places = (sim.relative_position(marble, CUPS[side]) for marble in MARBLES)
    return sum(math.hypot(x, y) < INNER_RADIUS and 0.0 < z < HEIGHT for x, y, z in places)


def done(sim: Simulation, target: Side) -> bool:
    """Both cups stand upright on their squares, let go, the one of a side with all marbles."""
    if not left_alone(sim, *CUPS.values()):
        return False
    for side in SIDES:
        x, y, _ = sim.relative_position(CUPS[side], SQUARES[side])
        stands = sim.contacts.between(CUPS[side], TABLE) and tilt(sim, CUPS[side]) < MAX_TILT
        if not (stands and max(abs(x), abs(y)) <= HALF_SQUARE):
            return False
    return _marbles_in(sim, target) == len(MARBLES)


def way(
    name: str = "",
    how: Pouring | None = None,
    act: Callable[[Arms, Pouring], Script] = pour,
    **fields: Any,
) -> Way:
    how = how or Pouring()
    targets: list[Side] = []

    def script(arms: Arms) -> Script:
        targets[:] = [min(SIDES, key=lambda side: _marbles_in(arms.sim, side))]
        yield from act(arms, how)

    name = name or numbers(how, fields)
    return Way(name=name, script=script, done=lambda sim: done(sim, targets[0]), **fields)


WAYS: tuple[Way, ...] = (
    way("poured at 5 cm", Pouring(height=0.05)),
    way("poured at 14 cm", Pouring(height=0.14)),
    way("poured at 100 degrees", Pouring(angle=math.radians(100.0))),
    way("poured at 120 degrees", Pouring(angle=math.radians(120.0))),
    way("poured in two goes", Pouring(goes=2)),
    way("poured slowly", Pouring(seconds=6.0)),
    way("cups let go 8 mm above the table", Pouring(drop=0.008)),
    way("cups pressed on the table", Pouring(drop=-0.003)),
    way("put back beside the middles", Pouring(place=(0.03, -0.03))),
    way("put down askew and shoved onto the squares", Pouring(place=(-0.07, 0.0)), act=push_home),
    way("grasped high", Pouring(grasps=(0.042, 0.042))),
    way("grasped low", Pouring(grasps=(0.028, 0.028))),
    way("hands from behind", Pouring(ahead=-0.2)),
    way("hands from ahead", Pouring(ahead=0.3)),
    way("trembling", tremble=0.01),
    way("half the speed", slowness=2),
)


def sample(rng: np.random.Generator) -> Way:
    """A way at random."""
    tremble, slowness = (0.01 if rng.random() < 0.15 else 0.0), (2 if rng.random() < 0.15 else 1)
    how = Pouring(
        height=rng.uniform(0.05, 0.14),
        angle=math.radians(rng.uniform(100.0, 120.0)),
        goes=1 + int(rng.random() < 0.3),
        seconds=rng.uniform(2.8, 5.0),
        grasps=(rng.uniform(0.029, 0.042), rng.uniform(0.029, 0.042)),
        drop=rng.uniform(-0.003, 0.008 if tremble == 0.0 else 0.004),
        place=(rng.uniform(-0.03, 0.03), rng.uniform(-0.03, 0.03)),
        ahead=rng.uniform(-0.2, 0.3),
        reach=rng.uniform(0.030, 0.038),
    )
    return way(how=how, tremble=tremble, slowness=slowness)
