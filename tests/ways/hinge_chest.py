"""Ways to put a cube into a chest whose lid another arm holds open, and to seem to."""

from __future__ import annotations

import math
from itertools import chain

import mujoco
import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.tasks.experts.handling import LET_GO, pick_cube
from duobench.tasks.experts.motion import (
    Arms,
    Script,
    down,
    follow,
    grip,
    move,
    release,
    together,
    wait,
)
from duobench.tasks.experts.scripts.hinge_chest import (
    HOLDER,
    INSERTER,
    Insertion,
    fetch,
    lower,
    open_lid,
    over,
    under_lid,
)
from duobench.tasks.hinge_chest import CAVITY_REGION, OPEN_ANGLE
from duobench.world.objects import chest as box
from duobench.world.objects.blocks import CUBE_EDGE
from duobench.world.objects.chest import (
    CAVITY,
    HINGE,
    LID_LENGTH,
    LID_UNDERSIDE,
    LIP,
    RIM_HEIGHT,
    WALL,
)
from duobench.world.scene.naming import gripper_name
from duobench.world.sim.simulation import Simulation
from tests.steps import Act, at_once, back, by, do, pause, to
from tests.ways.opening import Opening
from tests.ways.way import (
    ONE,
    SLOW,
    TURNS,
    Way,
    WayFailedError,
    cheats,
    random_slip,
    random_tempo,
    ways_to,
)

LID = "chest/lid"
_PICK_HEIGHT = 0.028
_ROD_Y, _ROD_SLOPE = 0.07, 1.1
"""The hand that holds the cube comes from the left, its back up: where along the front, and its
direction against the vertical."""
_OVER_FRONT, _ROD_DEPTH, _ROD_START = 0.065, 0.045, 0.03
_SLIDE, _TOP = 0.06, 1.25
_TAP_ANGLE = 1.3
_FAR, _STEP = 0.2, 0.004
"""How far a hand looks for the lid, and the largest change of its target in a control step, in
metres."""
_ABOVE = 0.15
"""Height of the tool in metres over the open chest."""
_PINCH, _AROUND_THE_LID = (0.012, -0.075), 0.5
"""Where fingers pinch the open lid from above: from its end, and along it, in metres; and how far
they are open before."""
AWAY = 0.015
"""From which distance on a hand does not hold the lid that lies on the other one, in metres."""
SHUTTING, PRESSED_STEPS = 2.0, 15
"""Moment about the hinge in N·m that turns the lid shut, and control steps for which it is so, half
a second, from which on a hand holds nothing [task definitions]."""
_PINCHED = 1.37
"""To which angle a hand that has pinched the lid raises it, in radians: off the other hand."""


def _rod(chest: SE3, x: float, z: float) -> SE3:
    """Tool pose with the fingers along the front, from the left, at (x, z) of the chest's frame."""
    lean = down(x, _ROD_Y, z, yaw=-math.pi / 2, tilt=_ROD_SLOPE)
    return chest @ lean @ SE3.at(yaw=math.pi)


def _under_lid(chest: SE3, angle: float) -> SE3:
    reach = box.LID_LENGTH + _OVER_FRONT - _SLIDE * angle / _TOP
    lid = SE3.about((0, 1, 0), angle).apply([-reach, 0.0, box.LID_UNDERSIDE - _ROD_DEPTH])
    return _rod(chest, box.HINGE[0] + lid[0], box.HINGE[2] + lid[2])


def _lift_with_the_back_of_the_hand(arms: Arms) -> Script:
    """The hand that holds the cube goes under the lip and follows the lid's arc."""
    chest = arms.sim.pose("chest")
    start = _rod(chest, -box.OUTER_X / 2 - _OVER_FRONT, _ROD_START)
    yield from to(arms, INSERTER, start @ SE3.at(z=-0.13), tolerance=0.02)
    yield from to(arms, INSERTER, start, speed=0.2)
    yield from to(arms, INSERTER, _under_lid(chest, 0.0), speed=0.1, arrive=False)
    yield from follow(arms, lambda f: {INSERTER: _under_lid(chest, f * _TOP)}, 2.0)
    yield from wait(20)


def _tap(arms: Arms) -> Script:
    """The right arm comes to the open lid from behind, touches it, and leaves."""
    beside = down(0.08, -0.20, 0.20, yaw=math.pi / 2, tilt=0.9) @ SE3.at(yaw=math.pi)
    near = arms.sim.pose("chest") @ beside
    yield from CHEST.tap(arms, near, _TAP_ANGLE, lambda pose: pose.moved(y=0.004))


def come_over_the_chest(arms: Arms) -> Script:
    y = arms.sim.pose("chest").apply([-0.025, 0.045, 0.0])[1]
    yield from to(arms, INSERTER, over(arms, y, 0.15), tolerance=0.01)


CHEST = Opening(
    lid=LID,
    fixture="chest",
    region=CAVITY_REGION,
    open_angle=OPEN_ANGLE,
    holder=HOLDER,
    opens=open_lid,
    fetches=fetch,
    comes_near=come_over_the_chest,
    puts_in=lower,
)


def up_and_aside(arms: Arms, up: float) -> Script:
    yield from by(arms, INSERTER, z=up, speed=0.3)
    yield from by(arms, INSERTER, y=0.2, speed=0.3)


def _lid_is_near(arms: Arms) -> float:
    """Distance in metres between the holding hand and the lid, at most `_FAR`."""
    sim = arms.sim
    model, data, ends = sim.model, sim.data, np.zeros(6)

    def geoms(prefix: str) -> list[int]:
        bodies = (model.body(body).name for body in model.geom_bodyid)
        return [geom for geom, name in enumerate(bodies) if name.startswith(prefix)]

    hand = [geom for geom in geoms(f"{gripper_name(HOLDER)}/") if model.geom_contype[geom]]
    return min(
        mujoco.mj_geomDistance(model, data, one, other, _FAR, ends)
        for one in hand
        for other in geoms(LID)
    )


def _hover(arms: Arms, gap: float, away: tuple[float, float, float]) -> Script:
    """The holding hand hovers at a distance from the lid, on the way `away` from it (table)."""
    way = np.array(away)
    for _ in range(90):
        error = gap - _lid_is_near(arms)
        if abs(error) < 0.001:
            break
        arms.targets[HOLDER] = arms.targets[HOLDER].moved(*(np.clip(error, -_STEP, _STEP) * way))
        yield


def hover_beside(arms: Arms, gap: float) -> Script:
    """The right hand leaves the lid to the hand with the cube, and hovers beside it."""
    yield from back(arms, HOLDER, 0.075)
    yield from wait(10)
    yield from _hover(arms, gap, (0.0, HOLDER.sign, 0.0))


def hover_at(arms: Arms, angle: float) -> Script:
    """The same at an angle about the hinge: 0 is beyond the lip, a right angle is above the lid."""
    yield from back(arms, HOLDER, 0.10)
    turn = arms.sim.angle(LID) + angle
    way = arms.sim.pose("chest").rotation @ [-math.cos(turn), 0.0, math.sin(turn)]
    yield from by(arms, HOLDER, *(0.12 * way))
    yield from back(arms, HOLDER, -0.07, arrive=False)
    yield from _hover(arms, 0.03, tuple(way))


def tap_from_beside(arms: Arms) -> Script:
    yield from to(arms, HOLDER, arms.targets[HOLDER] @ SE3.at(z=-0.075), arrive=False)
    while True:
        for step in (0.004, -0.004):
            for _ in range(8):
                arms.targets[HOLDER] = arms.targets[HOLDER] @ SE3.at(z=step)
                yield


def tapping(arms: Arms) -> Script:
    taps = tap_from_beside(arms)
    for _ in chain(wait(15), CHEST.insert(arms)):
        next(taps, None)
        yield


def _take_the_lid_again(arms: Arms) -> Script:
    chest, angle = arms.sim.pose("chest"), arms.sim.angle(LID) - 0.03
    again = under_lid(chest, HOLDER, angle)
    yield from to(arms, HOLDER, again @ SE3.at(z=-0.16), speed=0.6, arrive=False)
    yield from to(arms, HOLDER, again, speed=0.6, arrive=False)
    yield from follow(
        arms, lambda f: {HOLDER: under_lid(chest, HOLDER, angle + f * (_TOP - angle))}, 1.0
    )
    yield from up_and_aside(arms, 0.14)


def _touch_from_behind(arms: Arms) -> Script:
    """The right arm comes to the lid from behind, and touches it without bearing it."""
    chest = arms.sim.pose("chest")
    for x in (0.10, 0.0):
        behind = chest @ down(x, -0.20, 0.24, yaw=math.pi / 2, tilt=0.9) @ SE3.at(yaw=math.pi)
        for _ in to(arms, HOLDER, behind, speed=0.15):
            if x == 0.0 and arms.sim.contacts.gripper(HOLDER, LID):
                return
            yield


def drop_over(arms: Arms, y: float, height: float) -> Script:
    """The cube is let go above the open chest, at a place along its front; the height is that of
    the cube's lowest point above the rim.
    """
    place = arms.sim.pose("chest").apply([0.0, y, 0.0])[1]
    yield from to(arms, INSERTER, over(arms, place, _ABOVE), speed=0.3)
    lower = box.RIM_HEIGHT + height - arms.sim.min_height("cube")
    yield from to(arms, INSERTER, over(arms, place, _ABOVE + lower), speed=0.1)
    yield from wait(10)
    yield from CHEST.let_go(arms)


def in_and_out_again(arms: Arms) -> Script:
    yield from lower(arms)
    low = arms.targets[INSERTER].moved(z=box.WALL + CUBE_EDGE / 2 - 0.01 - 0.033)
    yield from to(arms, INSERTER, low, speed=0.1)
    yield from wait(15)
    yield from to(arms, INSERTER, low.moved(z=0.12))


def _bounces_off(sim: Simulation) -> bool:
    struck = sim.contacts.between("cube", "chest") and not CHEST.is_inside(sim)
    return struck and not sim.contacts.gripper(INSERTER, "cube")


def sink(arms: Arms, way: Insertion, start: float, end: float) -> Script:
    chest, holder = arms.sim.pose("chest"), way.side.other
    yield from follow(
        arms, lambda f: {holder: under_lid(chest, holder, start + f * (end - start))}, 0.4
    )


def _at_the_end(chest: SE3, angle: float, up: float = 0.0) -> SE3:
    """Tool pose of fingers around the end of the lid, open by `angle` radians, or `up` above it."""
    into, y = _PINCH
    reach = LID_LENGTH + LIP - into + up
    x, _, z = SE3.about((0, 1, 0), angle).apply([-reach, 0.0, LID_UNDERSIDE + WALL / 2])
    hand = SE3.about((0, 1, 0), angle - math.pi / 2) @ down(0.0, 0.0, 0.0, yaw=math.pi / 2)
    return chest @ SE3(hand.rotation, np.array([HINGE[0] + x, y, HINGE[2] + z]))


def pinch_the_lid(arms: Arms) -> Script:
    """The lid sinks onto the other hand; the holder pinches its end and raises it off that hand."""
    chest, high = arms.sim.pose("chest"), PLAIN.open_angle
    yield from sink(arms, PLAIN, high, high - 0.45)
    yield from wait(15)
    arms.openings[HOLDER.index] = _AROUND_THE_LID
    yield from back(arms, HOLDER, 0.16)
    yield from by(arms, HOLDER, z=0.15, arrive=False)
    start = arms.sim.angle(LID)
    yield from to(arms, HOLDER, _at_the_end(chest, start, 0.10), tolerance=0.02)
    yield from to(arms, HOLDER, _at_the_end(chest, start), speed=0.1)
    yield from grip(arms, HOLDER)
    yield from turn_pinched(arms, _PINCHED - start)
    yield from wait(10)


def turn_pinched(arms: Arms, turn: float) -> Script:
    """The holder turns the lid that it pinches by so many radians."""
    chest, start = arms.sim.pose("chest"), arms.sim.angle(LID)
    yield from follow(arms, lambda f: {HOLDER: _at_the_end(chest, start + f * turn)}, 1.0)
    yield from wait(20)


def wait_below(sunk: float, least: float = 0.0) -> Act:
    """The holder sinks by so many radians, the lid onto the other hand, and waits until the cube is
    in before it takes the lid again. It fails where it is less than `least` metres from the lid.
    """
    high, low = PLAIN.open_angle, PLAIN.open_angle - sunk
    down, up = (sink, PLAIN, high, low), (sink, PLAIN, low, high)
    begin = do(BOTH, OVER, down, (pause, 30), (_keep_away, least))
    return do(begin, CHEST.insert, (pause, 10), up, (up_and_aside, 0.14))


def _keep_away(arms: Arms, least: float) -> Script:
    if _lid_is_near(arms) < least:
        raise WayFailedError
    yield from ()


def insert_under_pressure(arms: Arms, turn: float) -> Script:
    """The cube goes in while the holder turns the lid that it pinches by so many radians, and the
    other hand keeps it open.
    """
    steps, sim = 0, arms.sim
    for _ in do((turn_pinched, turn), CHEST.insert)(arms):
        yield
        moment = sim.contacts.moment(HOLDER, LID, sim.hinge_axis(LID))
        steps += sim.contacts.arm(INSERTER, LID) and moment < -SHUTTING
    if steps < PRESSED_STEPS:
        raise WayFailedError


PLAIN = Insertion()
LEAVE = (back, HOLDER, 0.16)
LIFT = _lift_with_the_back_of_the_hand
ALONE = do((pick_cube, INSERTER, "cube", _PICK_HEIGHT), LIFT, CHEST.let_go)
BOTH, OVER = CHEST.hold_and_fetch, come_over_the_chest
LET_FALL = (BOTH, OVER, LEAVE, (pause, 20), CHEST.insert)
PINCHED = (BOTH, OVER, pinch_the_lid)
cheat = cheats(CHEST.is_in)
AGAIN, HELD = (CHEST.insert, _take_the_lid_again), {"deed": CHEST.held_open_at_last}
ADVERSARIES: dict[str, Way] = {
    "one arm lifts the lid with the back of the hand that holds the cube": cheat(1, ALONE, **ONE),
    "one arm opens the lid and leaves, the other one does it alone": cheat(
        1, open_lid, LEAVE, (CHEST.shut, 60), ALONE, **TURNS
    ),
    "the other hand touches the lid for a moment": cheat(
        1, (at_once, ALONE, _tap), deed=CHEST.tapped
    ),
    "the lid is left to the hand with the cube": cheat(2, BOTH, LEAVE, LIFT, CHEST.let_go),
    "the lid is let fall on the hand with the cube": cheat(2, *LET_FALL),
    "the lid is let fall on the hand with the cube, and only touched again": cheat(
        2, *LET_FALL, _touch_from_behind, (up_and_aside, 0.12)
    ),
    **{
        f"the hand that holds the lid {how}": cheat(
            2, BOTH, OVER, away, (pause, 10), *AGAIN, **HELD
        )
        for how, away in (
            ("is away while the cube goes in", LEAVE),
            ("hovers 20 mm beside it", (hover_beside, 0.020)),
            ("hovers 30 mm beside it", (hover_beside, 0.030)),
            ("hovers 39 mm beside it", (hover_beside, 0.039)),
            ("hovers beyond its lip", (hover_at, 0.0)),
            ("hovers above it", (hover_at, math.pi / 2)),
        )
    },
    **{
        f"the hand that holds the lid waits below it, sunk by {sunk} rad": cheat(
            2, wait_below(float(sunk), AWAY), **HELD
        )
        for sunk in ("0.3", "0.4", "0.5")
    },
    **{
        f"the hand that pinches the lid presses it shut by {a} rad while the cube goes in": cheat(
            2,
            *PINCHED,
            (insert_under_pressure, -float(a)),
            (up_and_aside, 0.14),
            lacks="right has turned chest/lid shut",
        )
        for a in ("0.25", "0.40")
    },
    "the hand that holds the lid taps at its edge": cheat(
        2, BOTH, OVER, tapping, _take_the_lid_again, **HELD
    ),
    **{
        f"the cube is dropped into the chest from {1000 * height:.0f} mm above the rim": cheat(
            2, BOTH, (drop_over, 0.045, height), lacks="when cube was let go: cube is "
        )
        for height in (0.15, 0.25)
    },
    "the cube is thrown on the rim": cheat(
        2, BOTH, (drop_over, box.OUTER_Y / 2, 0.03), deed=_bounces_off
    ),
    "the cube is put in and taken out again": cheat(
        2, BOTH, in_and_out_again, deed=CHEST.pinched_inside
    ),
}

# --- sincere ways ---------------------------------------------------------------------------------

OPEN = 0.8
"""Angle in radians from which on the lid counts as open [task definitions]."""
PLAY = 0.002
"""How far from the chest's floor a cube that lies on it may seem to be, in metres."""
HIGHEST = 0.077
"""How high above the rim a hand lets go that the lid keeps from coming lower, in metres."""
UPRIGHT, ROOM = 1.42, 0.1
"""Tilt of a hand and angle of the lid together in radians from which on the hand fits under the
lid, and how much further in it may go for each radian more, in metres."""
MOST_SLIPPED = 15
"""Control steps for which the lid lies on the hand below those in which the holder sinks and comes
back, a second in all with most of these [task definitions]."""
SINKS_TO = OPEN + 0.05
"""To which angle in radians a lid may sink onto the other hand."""
OUTWARD = 0.15
"""Share of the ways taken at random with a hand turned outwards."""
KINDS = (0.45, 0.1, 0.15, 0.2, 0.1)
"""Shares of those in which both arms work at once, one after the other, in which the lid sinks onto
the hand, in which the hand leans on it, and in which the holder stays right below it."""


def done(sim: Simulation) -> bool:
    """The cube lies in the chest, no hand is at it, and the lid is still open.

    The lid shuts by itself, and these scripts never lift it again: what is open for a second with
    nothing of the arm that brought the cube at it is held by the other one, and was all the time.
    """
    x, y, z = sim.relative_position("cube", "chest")
    hands = any(sim.contacts.arm(side, "cube") for side in Side)
    return (
        sim.contacts.between("cube", "chest")
        and abs(z - WALL - CUBE_EDGE / 2) < PLAY
        and abs(x) < CAVITY[0] / 2
        and abs(y) < CAVITY[1] / 2
        and sim.speed("cube")[0] < SLOW
        and not hands
        and not sim.contacts.arm(INSERTER, LID)
        and sim.angle(LID) >= OPEN
    )


def let_go(arms: Arms, way: Insertion) -> Script:
    """Let the cube go, unless the hand did not get it low enough, and leave the chest."""
    if arms.sim.min_height("cube") < RIM_HEIGHT + HIGHEST:
        yield from release(arms, way.side, opening=LET_GO)
    yield from retreat(arms, way)


def retreat(arms: Arms, way: Insertion) -> Script:
    here = arms.targets[way.side]
    yield from move(arms, {way.side: here.moved(z=0.13)}, speed=0.3)
    yield from move(arms, {way.side: here.moved(y=way.side.sign * 0.2, z=0.16)}, arrive=False)


def both(arms: Arms, way: Insertion) -> Script:
    yield from together(open_lid(arms, way), fetch(arms, way))


def put_in(way: Insertion) -> Act:
    """The expert's way with other numbers, and the hand leaves the chest."""
    return do((both, way), (lower, way), (let_go, way))


def one_after_the_other(way: Insertion) -> Act:
    return do((fetch, way), (open_lid, way), (lower, way), (let_go, way))


def slipped(way: Insertion, sunk: float, steps: int) -> Act:
    """The lid sinks by so many radians onto the inserting hand for some control steps, and the
    holder takes it again.
    """
    high, low = way.open_angle, way.open_angle - sunk
    down, up = (sink, way, high, low), (sink, way, low, high)
    return do((both, way), (pause, 10), (lower, way), down, (pause, steps), up, (let_go, way))


def along_the_lid(way: Insertion, lean: float) -> Act:
    """The hand that has come down is led so many metres towards the open lid, leans on it for half
    a second, and lets go there.
    """
    on_it = (by, way.side, {"x": lean, "speed": 0.1})
    return do((both, way), (pause, 10), (lower, way), on_it, (pause, 15), (let_go, way))


def _over_rim(height: float, grasp_height: float = PLAIN.grasp_height) -> float:
    """Height of the tool with the cube's lowest point at a height above the rim, in metres."""
    return RIM_HEIGHT + height + grasp_height


FRONT = (-0.045, 0.045)
"""Far in front of the open lid, in the chest's frame."""
STEEP = {"tilt": 0.0, "place": FRONT}
STOPPED = {"tilt": 0.0, "open_angle": 1.25}
BRUSH = Insertion(tilt=0.2, place=FRONT)
way = ways_to(lambda arms, how: put_in(how)(arms), done, PLAIN)
SINCERE: dict[str, Way] = {
    "as the expert, and the hand leaves": way(),
    "a hand that comes straight down": way(**STEEP),
    **{
        f"a hand straight down, its camera aside, the lid at {angle} rad": way(
            **STEEP, yaw=math.pi / 2, open_angle=angle
        )
        for angle in (1.1, 1.0)
    },
    "a hand straight down, the lid at its stop": way(**STEEP, open_angle=1.39),
    "a hand that leans by half a radian": way(tilt=0.5),
    "a lid opened to 1.1 rad": way(open_angle=1.1, tilt=0.5, place=FRONT),
    "a lid opened to 1.2 rad": way(open_angle=1.2, place=(-0.035, 0.045)),
    "far in front of the lid": way(place=FRONT),
    "near the hinge": way(place=(-0.005, 0.045), tilt=0.45),
    "at the left wall": way(place=(-0.03, 0.085)),
    "at the right of the middle": way(place=(-0.03, -0.02)),
    "let go at the rim": way(drop_height=0.085),
    **{
        f"let go {1000 * high:.0f} mm above the rim": way(drop_height=_over_rim(high))
        for high in (0.020, 0.040, 0.070)
    },
    "the lid stops a hand that comes straight down": way(**STOPPED, place=(-0.025, 0.045)),
    "the lid stops a hand that comes straight down far in front": way(
        **STOPPED, place=(-0.045, 0.02)
    ),
    "grasped at the tips of the fingers": way(grasp_height=0.045),
    "grasped deep in the fingers": way(grasp_height=0.026),
    "at half the speed": way(slowness=2),
    "trembling": way(tremble=0.01),
    "trembling, straight down": way(**STEEP, tremble=0.01),
    "one arm after the other": way(script=one_after_the_other(PLAIN)),
    "a hand that leans on the lid": way(script=along_the_lid(PLAIN, 0.03)),
    "a hand that leans hard on the lid": way(script=along_the_lid(BRUSH, 0.04)),
    "the holder pinches the end of the lid": way(
        script=do(*PINCHED, CHEST.insert, (pause, 10), (up_and_aside, 0.14))
    ),
    "the lid sinks onto the hand for a moment": way(script=slipped(PLAIN, 0.3, 10)),
    "the lid lies on the hand for a second": way(script=slipped(PLAIN, 0.4, 30)),
    **{
        f"the holder stays right below the lid, sunk by {sunk} rad": way(
            script=wait_below(float(sunk))
        )
        for sunk in ("0.08", "0.12", "0.16")
    },
}


def sample(rng: np.random.Generator) -> Way:
    open_angle = rng.uniform(1.0, 1.39)
    # A hand leans as the lid does, or goes in further in front of it.
    tilt = rng.uniform(max(0.0, UPRIGHT - open_angle), 0.5)
    room = ROOM * (tilt + open_angle - UPRIGHT)
    how = Insertion(
        open_angle=open_angle,
        place=(rng.uniform(-0.05, min(-0.05 + room, 0.0)), rng.uniform(-0.03, 0.08)),
        tilt=tilt,
        yaw=math.pi / 2 if rng.random() < OUTWARD else 0.0,
        grasp_height=(grasp := rng.uniform(0.026, 0.042)),
        drop_height=rng.uniform(0.042, _over_rim(0.05, grasp)),
    )
    steps = int(rng.integers(3, MOST_SLIPPED))
    kinds = (
        put_in(how),
        one_after_the_other(how),
        # It sinks, and stays open.
        slipped(how, rng.uniform(0.05, min(0.3, open_angle - SINKS_TO)), steps),
        along_the_lid(how, rng.uniform(0.0, 0.04)),
        wait_below(rng.uniform(0.0, 0.16)),
    )
    script = kinds[rng.choice(len(kinds), p=KINDS)]
    tempo = random_tempo(rng, trembling=0.25)
    return way(how, script=script, **tempo, **random_slip(rng, (INSERTER, "cube")))
