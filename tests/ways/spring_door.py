"""Ways to put a cube behind a door that another arm holds open, and to seem to."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import chain

import numpy as np

from duobench.core.spatial import SE3
from duobench.tasks.experts.handling import LET_GO, pick_cube
from duobench.tasks.experts.motion import (
    CAREFUL,
    CLOSED,
    NEAR,
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
from duobench.tasks.experts.scripts.spring_door import (
    HOLDER,
    INSERTER,
    at_bar,
    fetch,
    in_oven,
    open_door,
    reach_in,
)
from duobench.tasks.spring_door import FLOOR_REGION, OPEN_ANGLE
from duobench.world.objects.blocks import CUBE_EDGE
from duobench.world.objects.microwave import (
    BAR,
    CAVITY,
    CAVITY_CENTRE_Y,
    FLOOR,
    FRONT,
    HEIGHT,
    HINGE,
)
from duobench.world.sim.simulation import Simulation
from tests.steps import at_once, back, by, do, pause, to
from tests.ways.opening import Opening
from tests.ways.way import (
    ONE,
    TURNS,
    Way,
    WayFailedError,
    cheats,
    left_alone,
    random_tempo,
    ways_to,
)

_HOOK = (0.030, 0.020)
"""Where the fingertips are behind the bar: towards the door, and towards its hinge, in metres."""
_HOOK_HEIGHT = 0.15
_HOOK_YAW, _HOOK_SLOPE, _HOOK_TURN = 0.9, 0.8, 0.7
"""Direction of the dragging hand, and how much it turns with the door."""
_DRAGGED = 1.2
_TAP_ANGLE = 0.9
_TAP_STEPS = 5
_UNDER_THE_ROOF = 0.095
"""How much higher than the expert a hand lets the cube go under the roof, in metres."""
_AROUND_THE_BAR = 0.6
"""Opening of the hand that goes around the bar."""


def _hook(oven: SE3, angle: float) -> SE3:
    """Tool pose with the fingers, that hold the cube, behind the bar of the open door."""
    door = oven @ SE3.at(*HINGE) @ SE3.about((0, 0, -1), angle)
    x, y, z = door.apply([BAR[0] + _HOOK[0], BAR[1] + _HOOK[1], _HOOK_HEIGHT - HEIGHT / 2])
    yaw = oven.yaw + _HOOK_YAW - _HOOK_TURN * angle
    return down(x, y, z, yaw=yaw, tilt=_HOOK_SLOPE) @ SE3.at(yaw=math.pi / 2)


def _drag(arms: Arms, near: float = 0.02) -> Script:
    """The right hand, which may hold the cube, drags the door open with its knuckles."""
    oven = arms.sim.pose("microwave")
    shut = _hook(oven, 0.0)
    yield from to(arms, INSERTER, shut @ SE3.at(z=-0.12), tolerance=near)
    yield from to(arms, INSERTER, shut, speed=0.15)
    yield from follow(arms, lambda f: {INSERTER: _hook(oven, f * _DRAGGED)}, 3.0)


def _tap(arms: Arms) -> Script:
    """The left hand comes to the open door from outside, touches it, and leaves."""
    near = at_bar(arms.sim.pose("microwave"), _DRAGGED) @ SE3.at(z=-0.12)
    yield from DOOR.tap(arms, near, _TAP_ANGLE, lambda pose: pose @ SE3.at(z=0.004))


def come_to_the_door(arms: Arms) -> Script:
    """The hand with the cube stops in the doorway, on the side of the hinge."""
    near = in_oven(arms) @ SE3.at(z=-0.09)
    yield from to(arms, INSERTER, near.moved(y=0.05), tolerance=0.012)


DOOR = Opening(
    lid="microwave/door",
    fixture="microwave",
    region=FLOOR_REGION,
    open_angle=OPEN_ANGLE,
    holder=HOLDER,
    opens=open_door,
    fetches=fetch,
    comes_near=come_to_the_door,
    puts_in=reach_in,
)


def _take_the_door_again(arms: Arms) -> Script:
    """The left hand grasps the bar and takes the door off the other arm, which leaves."""
    oven, angle = arms.sim.pose("microwave"), arms.sim.angle(DOOR.lid)
    arms.openings[HOLDER.index] = _AROUND_THE_BAR
    again = at_bar(oven, angle)
    yield from to(arms, HOLDER, again @ SE3.at(z=-0.05), speed=0.6, arrive=False)
    yield from to(arms, HOLDER, again, speed=0.5, arrive=False)
    yield from grip(arms, HOLDER)
    wider = max(0.0, _DRAGGED - angle)
    yield from follow(arms, lambda f: {HOLDER: at_bar(oven, angle + f * wider)}, 1.0)
    yield from withdraw(arms, -0.3)


def press_shut(arms: Arms, by: float) -> Script:
    """The left hand opens its fingers around the bar and goes back, by so many radians of the
    door, so that it presses the door shut from outside, while the other arm holds it open.
    """
    oven, angle = arms.sim.pose("microwave"), arms.sim.angle(DOOR.lid)
    yield from release(arms, HOLDER, opening=_AROUND_THE_BAR)
    yield from follow(arms, lambda f: {HOLDER: at_bar(oven, angle - f * by)}, 0.6)
    yield from wait(20)


def pull_shut(arms: Arms, by: float) -> Script:
    """The left hand keeps its grasp of the bar, and leads the door back onto the other arm."""
    oven, angle = arms.sim.pose("microwave"), arms.sim.angle(DOOR.lid)
    yield from follow(arms, lambda f: {HOLDER: at_bar(oven, angle - f * by)}, 0.6)
    yield from wait(10)


def tapping(arms: Arms) -> Script:
    oven, angle = arms.sim.pose("microwave"), arms.sim.angle(DOOR.lid)
    yield from release(arms, HOLDER, opening=_AROUND_THE_BAR)
    for number, _ in enumerate(chain(wait(20), DOOR.insert(arms))):
        away = 0.3 if number % 15 < _TAP_STEPS else 0.05
        arms.targets[HOLDER] = at_bar(oven, angle - away)
        yield


def from_on_high(arms: Arms) -> Script:
    """The cube is let go as high above the floor as the roof lets the hand."""
    high = in_oven(arms).moved(z=_UNDER_THE_ROOF)
    yield from to(arms, INSERTER, high @ SE3.at(z=-0.10), tolerance=0.02)
    yield from to(arms, INSERTER, high, speed=0.1)
    yield from DOOR.let_go(arms)


def withdraw(arms: Arms, y: float) -> Script:
    out = arms.targets[INSERTER] @ SE3.at(z=-0.12)
    yield from to(arms, INSERTER, out, arrive=False)
    yield from to(arms, INSERTER, out.moved(x=-0.15, y=y), tolerance=0.02)


def in_and_out_again(arms: Arms) -> Script:
    yield from reach_in(arms)
    yield from by(arms, INSERTER, z=-0.012, speed=0.1)
    yield from wait(15)
    yield from to(arms, INSERTER, in_oven(arms) @ SE3.at(z=-0.15))


def _dragged_open(sim: Simulation) -> bool:
    """The door is open, and the hand that holds the cube is what holds it open."""
    lone = sim.contacts.arm(INSERTER, DOOR.lid) and sim.contacts.grasped(INSERTER, "cube")
    return lone and not sim.contacts.arm(HOLDER, DOOR.lid) and sim.angle(DOOR.lid) >= OPEN_ANGLE


def _wedged(sim: Simulation) -> bool:
    return sim.contacts.between("cube", DOOR.lid) and sim.contacts.between("cube", "microwave")


LEAVE = do((release, HOLDER), (back, HOLDER, 0.12))
ALONE = do(fetch, _drag, (pause, 30))
BOTH, NEAR_DOOR = DOOR.hold_and_fetch, come_to_the_door
IN, AGAIN = {"deed": DOOR.is_in}, _take_the_door_again
cheat, HELD = cheats(_dragged_open), {"deed": DOOR.held_open_at_last}
ADVERSARIES: dict[str, Way] = {
    "one arm drags the door open with its knuckles while it holds the cube": cheat(1, ALONE, **ONE),
    "one arm opens the door and leaves, the other one drags it open with the cube": cheat(
        1, open_door, LEAVE, (DOOR.shut, 90), ALONE, **TURNS
    ),
    "the other hand touches the door for a moment": cheat(
        1, (at_once, ALONE, _tap), deed=DOOR.tapped
    ),
    "the door is let fall on the arm with the cube": cheat(
        2, BOTH, NEAR_DOOR, LEAVE, (pause, 20), DOOR.insert, **IN
    ),
    "the hand that holds the door is away while the cube goes in": cheat(
        2,
        BOTH,
        NEAR_DOOR,
        (release, HOLDER),
        (back, HOLDER, 0.05, {"speed": 0.5, "arrive": False}),
        (pause, 10),
        DOOR.insert,
        AGAIN,
        **HELD,
    ),
    **{
        f"the hand that holds the door presses it shut by {a} rad while the cube goes in": cheat(
            2, BOTH, NEAR_DOOR, (press_shut, float(a)), DOOR.insert, AGAIN, **HELD
        )
        for a in ("0.16", "0.24", "0.30")
    },
    **{
        f"the hand that grasps the door pulls it shut by {a} rad while the cube goes in": cheat(
            2,
            BOTH,
            NEAR_DOOR,
            (pull_shut, float(a)),
            DOOR.insert,
            **IN,
            lacks="left has turned microwave/door shut",
        )
        for a in ("0.10", "0.15")
    },
    "the hand that holds the door taps at it from outside while the cube goes in": cheat(
        2, BOTH, NEAR_DOOR, tapping, AGAIN, **HELD
    ),
    "the cube is let go high above the floor": cheat(
        2, BOTH, from_on_high, **IN, lacks="when cube was let go: cube is "
    ),
    "the cube is wedged in the door": cheat(
        2,
        BOTH,
        (reach_in, {"depth": -0.07}),
        DOOR.let_go,
        (withdraw, -0.35),
        LEAVE,
        (pause, 60),
        deed=_wedged,
        lacks="cube touches microwave/door",
    ),
    "the cube is put in and taken out again": cheat(
        2, BOTH, in_and_out_again, deed=DOOR.pinched_inside
    ),
}

# --- sincere ways ---------------------------------------------------------------------------------

AROUND_BAR = 0.55
BEHIND_BAR = (0.028, -0.020)
"""Where hooked fingertips are, from the bar: towards the door, and away from its hinge, in
metres."""
PUSH, PUSHED = 0.1, -0.25
"""How far the left hand pushes the open door further, in radians, and where, along the door from
its hinge, in metres."""
AWAY = (0.4, -0.35, 0.3)
"""Where the right hand goes from the door, in metres."""
HIGHEST = 0.060
"""How high above the floor a hand that does not get lower lets go, in metres."""
ABOVE_FLOOR = 0.030
"""Height above the floor at which the cube comes in, before it is let down, in metres."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Putting:
    """How the door is held and the cube put in; the defaults are about the expert's way."""

    angle: float = 1.15
    """How far the door is opened, in radians."""
    hooked: bool = False
    """Whether closed fingers hook the bar from behind; otherwise they grasp it."""
    bar_height: float = 0.19
    """Where the bar is held, in metres above the table."""
    aslant: float = -1.1
    below: float = 1.75
    """Direction of the holding hand: against the shut door's normal, and against straight down."""
    grasp: float = 0.031
    grasp_tilt: float = 0.1
    """Height in metres of the tool that grasps the cube, and how far it leans back."""
    place: tuple[float, float] = (0.05, -0.05)
    """Where the cube is let go: behind the front, and to the left of the cavity's middle."""
    drop: float = 0.005
    """How high above the floor its lowest point is then, in metres."""
    slope: float = 0.78
    azimuth: float = -0.2
    """Direction of the inserting hand: against straight down, and against the oven's depth."""


def put_in(arms: Arms, how: Putting) -> Script:
    yield from together(_open(arms, how), _fetch(arms, how))
    yield from _bring(arms, how)


def from_inside(arms: Arms) -> Script:
    """The right hand drags the door open; the left one takes it over, pushing from inside."""
    how, oven = Putting(place=(0.05, -0.11)), arms.sim.pose("microwave")
    yield from grip(arms, HOLDER, INSERTER)
    yield from _drag(arms, NEAR)
    angle = arms.sim.angle(DOOR.lid)
    clear = _pushing(oven, angle, 0.06)
    yield from move(arms, {HOLDER: clear.moved(z=0.20)}, tolerance=NEAR)
    yield from move(arms, {HOLDER: clear}, speed=CAREFUL)
    yield from move(arms, {HOLDER: _pushing(oven, angle + PUSH, 0.03)}, speed=0.1)
    back = arms.targets[INSERTER] @ SE3.at(z=-0.15)
    yield from move(arms, {INSERTER: back}, speed=CAREFUL)
    yield from move(arms, {INSERTER: down(*AWAY)}, tolerance=NEAR)
    yield from _fetch(arms, how)
    yield from _bring(arms, how)


def _pushing(oven: SE3, angle: float, gap: float) -> SE3:
    """Tool pose of the left hand from above, `gap` metres off the inside of the open door."""
    door = oven @ SE3.at(*HINGE) @ SE3.about((0, 0, -1), angle)
    x, y, _ = door.apply([gap, PUSHED, 0.0])
    return down(x, y, 0.22, yaw=oven.yaw - 0.4, tilt=0.3)


def _fetch(arms: Arms, how: Putting) -> Script:
    yield from pick_cube(arms, INSERTER, "cube", how.grasp, tilt=how.grasp_tilt)


def over_the_sill(arms: Arms) -> Script:
    """The cube is set on the sill, half outside, and pushed in by closed fingers."""
    how = Putting(place=(-0.006, -0.05), slope=0.78)
    yield from put_in(arms, how)
    yield from grip(arms, INSERTER, opening=CLOSED)
    oven = arms.sim.pose("microwave")

    def tip(depth: float) -> SE3:
        y, z = CAVITY_CENTRE_Y + how.place[1], FLOOR + CUBE_EDGE / 2 + 0.012
        return oven @ down(FRONT + depth, y, z, yaw=0.0, tilt=1.1)

    yield from move(arms, {INSERTER: tip(-0.09)}, tolerance=NEAR)
    yield from move(arms, {INSERTER: tip(0.045)}, speed=0.1)
    yield from move(arms, {INSERTER: tip(-0.12)}, speed=CAREFUL)
    yield from move(arms, {INSERTER: tip(-0.12).moved(x=-0.10, y=-0.25)}, arrive=False)


def _at_bar(oven: SE3, angle: float, how: Putting) -> SE3:
    """Tool pose of the holding hand at the bar of a door that is open by `angle` radians."""
    door = oven @ SE3.at(*HINGE) @ SE3.about((0, 0, -1), angle)
    hand = down(0.0, 0.0, 0.0, yaw=how.aslant, tilt=how.below) @ SE3.at(yaw=math.pi)
    x, y = BAR
    if how.hooked:
        x, y = x + BEHIND_BAR[0], y + BEHIND_BAR[1]
    return door @ SE3(hand.rotation, np.array([x, y, how.bar_height - HEIGHT / 2]))


def _open(arms: Arms, how: Putting) -> Script:
    oven = arms.sim.pose("microwave")
    yield from grip(arms, HOLDER, opening=CLOSED if how.hooked else AROUND_BAR)
    shut = _at_bar(oven, 0.0, how)
    yield from move(arms, {HOLDER: shut @ SE3.at(z=-0.12)}, tolerance=NEAR)
    yield from move(arms, {HOLDER: shut}, speed=0.2)
    yield from grip(arms, HOLDER)
    yield from follow(arms, lambda f: {HOLDER: _at_bar(oven, f * how.angle, how)}, 3.0)


def _bring(arms: Arms, how: Putting) -> Script:
    oven = arms.sim.pose("microwave")
    x, y = FRONT + how.place[0], CAVITY_CENTRE_Y + how.place[1]
    hand = down(x, y, FLOOR + ABOVE_FLOOR + CUBE_EDGE / 2, yaw=how.azimuth, tilt=how.slope)
    inside = oven @ hand
    yield from move(arms, {INSERTER: inside @ SE3.at(z=-0.10 - how.place[0])}, tolerance=NEAR)
    yield from move(arms, {INSERTER: inside}, speed=CAREFUL)
    for _ in range(2):
        high = arms.sim.min_height("cube") - oven.translation[2] - FLOOR
        lower = arms.tcp_pose(INSERTER).translation[2] + how.drop - high
        x, y, _ = arms.targets[INSERTER].translation
        goal = SE3(arms.targets[INSERTER].rotation, np.array([x, y, lower]))
        yield from move(arms, {INSERTER: goal}, speed=0.1)
    height = arms.sim.min_height("cube") - oven.translation[2] - FLOOR
    if height > HIGHEST >= how.drop:
        raise WayFailedError
    yield from release(arms, INSERTER, opening=LET_GO)
    out = arms.targets[INSERTER] @ SE3.at(z=-0.10 - how.place[0])
    yield from move(arms, {INSERTER: out}, speed=CAREFUL)
    yield from move(arms, {INSERTER: out.moved(x=-0.10, y=-0.25)}, arrive=False)


def done(sim: Simulation) -> bool:
    """The cube lies on the cavity's floor, behind the front, and nothing holds it."""
    x, y, z = sim.relative_position("cube", "microwave")
    half = CUBE_EDGE / 2
    inside = FRONT + half <= x <= FRONT + CAVITY[0] and abs(y - CAVITY_CENTRE_Y) < CAVITY[1] / 2
    on_floor = abs(z - FLOOR - half) < half / 2 and sim.contacts.between("cube", "microwave")
    clear = not sim.contacts.between("cube", DOOR.lid)
    return inside and on_floor and clear and left_alone(sim, "cube")


HOOK = {"hooked": True, "aslant": -1.2, "below": 1.2}
way = ways_to(put_in, done, Putting())
SINCERE: dict[str, Way] = {
    **{f"the door opened to {angle} rad": way(angle=angle) for angle in (0.92, 1.4, 1.8)},
    "closed fingers hook the bar": way(**HOOK, bar_height=0.16),
    "a hand holds the door from inside": way(script=from_inside),
    "the bar is held low": way(bar_height=0.13),
    "on the left of the floor": way(place=(0.06, 0.06), azimuth=0.0, slope=0.95),
    "on the right of the floor": way(place=(0.06, -0.11)),
    "at the back of the floor": way(place=(0.18, 0.0), slope=1.15),
    "let go 25 mm above the floor": way(drop=0.025),
    "let go 40 mm above the floor": way(drop=0.040),
    "let go 50 mm above the floor": way(drop=0.050, slope=1.0),
    "set on the sill and pushed in": way(script=over_the_sill),
    "pressed on the floor": way(drop=-0.004),
    "a flat hand": way(slope=1.2),
    "a steep hand": way(slope=0.6, place=(0.04, -0.05)),
    "grasped deep in the fingers": way(grasp=0.022),
    "grasped with the tips": way(grasp=0.036),
    "trembling": way(tremble=0.01),
    "half the speed": way(slowness=2),
}


def sample(rng: np.random.Generator) -> Way:
    depth = rng.uniform(0.03, 0.18)
    hooked = rng.random() < 0.3
    hold = HOOK if hooked else {"aslant": rng.uniform(-1.2, -1.0), "below": rng.uniform(1.65, 1.85)}
    return way(
        **hold,
        angle=rng.uniform(0.92, 1.8),
        # Higher, the hooked hand comes to the end of its arm.
        bar_height=rng.uniform(0.14, 0.17 if hooked else 0.20),
        grasp=rng.uniform(0.022, 0.036),
        grasp_tilt=rng.uniform(0.0, 0.3),
        place=(depth, rng.uniform(-0.11, 0.06)),
        drop=rng.uniform(-0.004, 0.050),
        slope=0.75 + 2.0 * depth + rng.uniform(0.0, 0.15),
        azimuth=rng.uniform(-0.3, 0.1),
        **random_tempo(rng, trembling=0.2),
    )
