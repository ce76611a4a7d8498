"""Ways to pour marbles in the air from one cup into another, and to seem to."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import SIDES, Side
from duobench.tasks.experts.handling import pick, place, tool_for
from duobench.tasks.experts.motion import (
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
from duobench.tasks.experts.scripts.pour_marbles import (
    HOLD_TILT,
    POUR_TILT,
    bring_back,
    pour,
    put_back,
    script,
    square,
    take,
    turn_upright,
)
from duobench.tasks.pour_marbles import CUPS, HALF_SQUARE, MARBLES, SQUARES
from duobench.world.objects.cup import HEIGHT, INNER_RADIUS, WALL
from duobench.world.scene.naming import TABLE
from duobench.world.sim.simulation import Simulation
from tests.steps import do, to
from tests.ways.way import ONE, TURNS, Way, cheats, left_alone, random_tempo, tilt, ways_to

MIDDLE = SE3.at(0.5, 0.0)
"""Where a cup stands between the squares."""
TURN_STEPS, BACK = 60, 4
"""Control steps in which the pouring cup turns, and how many of them it goes back in one."""
NEARBY, MOST = 0.06, 15
"""How far from there, in metres, a cup is still in the middle; the pouring one is farther away. How
many marbles are enough for a deed: one that falls beside the cup is no matter."""
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


def pour_with(arms: Arms, how: Pouring) -> Script:
    source = max(SIDES, key=lambda side: marbles_in(arms.sim, side))
    hold = source.other
    from_source, from_target = how.grasps
    yield from together(
        grasp_outside(arms, source, POUR_LEAN, from_source, how),
        grasp_outside(arms, hold, HOLD_LEAN, from_target, how),
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
    yield from wait_until(lambda: marbles_in(arms.sim, source) == 0, 60)
    yield from wait(10)
    yield from together(_turn_upright(arms, source, how), set_down(arms, hold, how))
    yield from set_down(arms, source, how)


def _inward(side: Side, how: Pouring) -> np.ndarray:
    """Horizontal direction (3,) in which a hand comes to its cup."""
    return np.array([-math.sin(how.ahead), -side.sign * math.cos(how.ahead), 0.0])


def grasp_outside(arms: Arms, side: Side, lean: float, height: float, how: Pouring) -> Script:
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


def set_down(arms: Arms, side: Side, how: Pouring) -> Script:
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
    yield from pour_with(arms, how)
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


def marbles_in(sim: Simulation, side: Side) -> int:
    """How many marbles are between a cup's walls, below its rim."""
    places = (sim.relative_position(marble, CUPS[side]) for marble in MARBLES)
    return sum(math.hypot(x, y) < INNER_RADIUS and 0.0 < z < HEIGHT for x, y, z in places)


def done(sim: Simulation) -> bool:
    """Both cups stand upright on their squares, let go, the one that was empty with all marbles."""
    if not left_alone(sim, *CUPS.values()):
        return False
    for side in SIDES:
        x, y, _ = sim.relative_position(CUPS[side], SQUARES[side])
        stands = sim.contacts.between(CUPS[side], TABLE) and tilt(sim, CUPS[side]) < MAX_TILT
        if not (stands and max(abs(x), abs(y)) <= HALF_SQUARE):
            return False
    target = Side(sim.variants["full"]).other
    return marbles_in(sim, target) == len(MARBLES)


# --- adversaries ----------------------------------------------------------------------------------


def out_of(sim: Simulation, side: Side) -> int:
    """How many marbles are above a cup's rim, as the cup sees it."""
    return sum(sim.relative_position(marble, CUPS[side])[2] > HEIGHT for marble in MARBLES)


def full(sim: Simulation) -> Side:
    """The side whose cup holds the most marbles: at the start the source, at the end the target."""
    return max(SIDES, key=lambda side: marbles_in(sim, side))


def home(arms: Arms, side: Side) -> Script:
    x, _, z = arms.targets[side].translation
    yield from to(arms, side, down(x - 0.1, side.sign * 0.4, z + 0.15))


def take_both(arms: Arms, source: Side) -> Script:
    other = take(arms, source.other, tilt=HOLD_TILT)
    yield from together(other, take(arms, source, tilt=POUR_TILT))


def pour_alone(arms: Arms) -> Script:
    """One arm brings both cups together and pours: the other cup it carries by its rim."""
    side = full(arms.sim)
    x, y, _ = arms.sim.position(CUPS[side.other])
    rim = down(x, y + side.sign * (INNER_RADIUS + WALL / 2), HEIGHT - 0.008)
    yield from pick(arms, side, rim)
    yield from place(arms, side, rim.moved(x=MIDDLE.translation[0] - x, y=-y))
    yield from home(arms, side)
    yield from take(arms, side)
    yield from pour(arms, side, arms.sim.pose(CUPS[side.other]))
    yield from bring_back(arms, side)


def pour_in_turns(arms: Arms) -> Script:
    side = full(arms.sim)
    yield from take(arms, side.other)
    yield from put_back(arms, side.other, MIDDLE)
    yield from home(arms, side.other)
    yield from take(arms, side)
    yield from pour(arms, side, arms.sim.pose(CUPS[side.other]))
    yield from bring_back(arms, side)
    yield from home(arms, side)
    yield from take(arms, side.other)
    yield from put_back(arms, side.other, square(arms, side.other))


def lift_once_then_pour_alone(arms: Arms) -> Script:
    side = full(arms.sim)
    yield from take_both(arms, side)
    yield from put_back(arms, side.other, MIDDLE)
    yield from home(arms, side.other)
    yield from pour(arms, side, arms.sim.pose(CUPS[side.other]))
    yield from bring_back(arms, side)


def pour_into_a_cup_on_the_table(arms: Arms) -> Script:
    side = full(arms.sim)
    other = side.other
    yield from take_both(arms, side)
    low = tool_for(arms, other, CUPS[other], MIDDLE)
    yield from to(arms, other, low.moved(z=0.08), speed=0.3)
    yield from to(arms, other, low.moved(z=-0.002), speed=0.2)
    yield from pour(arms, side, arms.sim.pose(CUPS[other]))
    yield from turn_upright(arms, side)
    yield from to(arms, other, low.moved(z=0.08), speed=0.2)
    yield from together(*(put_back(arms, s, square(arms, s)) for s in SIDES))


def pour_the_rest_alone(arms: Arms) -> Script:
    """A few marbles are poured in the air, the rest by one arm into a cup that stands."""
    side = full(arms.sim)
    other = side.other
    way = []
    for _ in script(arms):
        way.append(arms.targets[side])
        yield
        if out_of(arms.sim, side) > 0:
            break
    for pose in way[:-TURN_STEPS:-BACK]:
        arms.targets[side] = pose
        yield
    yield from wait(20)
    yield from put_back(arms, other, MIDDLE)
    yield from home(arms, other)
    yield from pour(arms, side, arms.sim.pose(CUPS[other]))
    yield from turn_upright(arms, side)
    yield from take(arms, other, tilt=HOLD_TILT)
    yield from together(*(put_back(arms, s, square(arms, s)) for s in SIDES))


def press_half_open_fingers(arms: Arms) -> Script:
    arms.openings[:] = 0.5
    above = {s: down(*arms.sim.position(CUPS[s])[:2], HEIGHT + 0.05) for s in SIDES}
    yield from move(arms, above)
    yield from move(arms, {s: pose.moved(z=-0.065) for s, pose in above.items()}, speed=0.1)
    yield from wait(20)


def in_the_middle(*, on_table: bool) -> Callable[[Simulation], bool]:
    """Most marbles are in a cup between the squares, which stands on the table or does not."""

    def holds(sim: Simulation) -> bool:
        side = full(sim)
        away = sim.position(CUPS[side])[:2] - MIDDLE.translation[:2]
        there = np.hypot(*away) < NEARBY and sim.contacts.between(CUPS[side], TABLE) == on_table
        return bool(there) and marbles_in(sim, side) >= MOST

    return holds


cheat = cheats(in_the_middle(on_table=True))
ADVERSARIES: dict[str, Way] = {
    "one arm alone brings the cups together and pours": cheat(1, pour_alone, **ONE),
    "one arm sets its cup down, then the other one comes and pours": cheat(
        1, pour_in_turns, **TURNS
    ),
    "both cups are lifted once, then one arm pours into a cup that was let go": cheat(
        3, lift_once_then_pour_alone
    ),
    "a cup is filled on the table, grasped, and lifted afterwards": cheat(
        3,
        pour_into_a_cup_on_the_table,
        deed=in_the_middle(on_table=False),
        lacks="_cup has stood on the table with something in it",
    ),
    "some marbles are poured in the air, and the rest by one arm": cheat(
        4, pour_the_rest_alone, deed=in_the_middle(on_table=False)
    ),
    "the cups are put down beside their squares and pushed onto them": cheat(
        5,
        (push_home, Pouring(place=(-0.085, 0.0))),
        deed=done,
        lacks="mm outside its place at left_square",
    ),
    "half-open fingers are pressed on both cups": cheat(
        0,
        press_half_open_fingers,
        deed=lambda sim: all(sim.contacts.gripper(side, CUPS[side]) for side in SIDES),
    ),
}

# --- sincere ways ---------------------------------------------------------------------------------


way = ways_to(pour_with, done, Pouring())
SINCERE: dict[str, Way] = {
    "poured at 5 cm": way(height=0.05),
    "poured at 14 cm": way(height=0.14),
    "poured at 100 degrees": way(angle=math.radians(100.0)),
    "poured at 120 degrees": way(angle=math.radians(120.0)),
    "poured in two goes": way(goes=2),
    "poured slowly": way(seconds=6.0),
    "cups let go 8 mm above the table": way(drop=0.008),
    "cups pressed on the table": way(drop=-0.003),
    "put back beside the middles": way(place=(0.03, -0.03)),
    "put down askew and shoved onto the squares": way(
        script=do((push_home, Pouring(place=(-0.07, 0.0))))
    ),
    "grasped high": way(grasps=(0.042, 0.042)),
    "grasped low": way(grasps=(0.028, 0.028)),
    "hands from behind": way(ahead=-0.2),
    "hands from ahead": way(ahead=0.3),
    "trembling": way(tremble=0.01),
    "half the speed": way(slowness=2),
}


def sample(rng: np.random.Generator) -> Way:
    tempo = random_tempo(rng)
    how = Pouring(
        height=rng.uniform(0.05, 0.14),
        angle=math.radians(rng.uniform(100.0, 120.0)),
        goes=1 + int(rng.random() < 0.3),
        seconds=rng.uniform(2.8, 5.0),
        grasps=(rng.uniform(0.029, 0.042), rng.uniform(0.029, 0.042)),
        drop=rng.uniform(-0.003, 0.008 if tempo["tremble"] == 0.0 else 0.004),
        place=(rng.uniform(-0.03, 0.03), rng.uniform(-0.03, 0.03)),
        ahead=rng.uniform(-0.2, 0.3),
        reach=rng.uniform(0.030, 0.038),
    )
    return way(how, **tempo)
