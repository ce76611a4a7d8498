"""Sincere ways in spring_door: other doors' angles, holds, slopes, places and heights."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from duobench.experts.handling import LET_GO, pick_cube
from duobench.experts.motion import (
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
)
from duobench.experts.scripts.spring_door import HOLDER, INSERTER
from duobench.objects.blocks import CUBE_EDGE
from duobench.objects.microwave import BAR, CAVITY, CAVITY_CENTRE_Y, FLOOR, FRONT, HEIGHT, HINGE
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from tests.sincere.sincere import Way, left_alone, ways_to

DOOR = "microwave/door"
AROUND_BAR = 0.55
BEHIND_BAR = (0.028, -0.020)
"""Where hooked fingertips are, from the bar: towards the door, and away from its hinge, in
metres."""
DRAGGED, PUSH, PUSHED = 1.2, 0.1, -0.25
"""How far the right hand drags the door open, and the left one pushes it further, in radians; where
that one pushes, along the door from its hinge, in metres."""
AWAY = (0.4, -0.35, 0.3)
"""Where the right hand goes from the door, in metres."""
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
    """Open the door, hold it open, put the cube in."""
    yield from together(_open(arms, how), _fetch(arms, how))
    yield from _bring(arms, how)


def from_inside(arms: Arms) -> Script:
    """The right hand drags the door open; the left one takes it over, pushing from inside."""
    how, oven = Putting(place=(0.05, -0.11)), arms.sim.pose("microwave")
    yield from grip(arms, HOLDER, INSERTER)
    yield from move(arms, {INSERTER: _dragging(oven, 0.0) @ SE3.at(z=-0.12)}, tolerance=NEAR)
    yield from move(arms, {INSERTER: _dragging(oven, 0.0)}, speed=0.15)
    yield from follow(arms, lambda f: {INSERTER: _dragging(oven, f * DRAGGED)}, 3.0)
    angle = arms.sim.angle(DOOR)
    clear = _pushing(oven, angle, 0.06)
    yield from move(arms, {HOLDER: clear.moved(z=0.20)}, tolerance=NEAR)
    yield from move(arms, {HOLDER: clear}, speed=CAREFUL)
    yield from move(arms, {HOLDER: _pushing(oven, angle + PUSH, 0.03)}, speed=0.1)
    back = arms.targets[INSERTER] @ SE3.at(z=-0.15)
    yield from move(arms, {INSERTER: back}, speed=CAREFUL)
    yield from move(arms, {INSERTER: down(*AWAY)}, tolerance=NEAR)
    yield from _fetch(arms, how)
    yield from _bring(arms, how)


def _dragging(oven: SE3, angle: float) -> SE3:
    """Tool pose of the right hand with closed fingers behind the bar of the open door."""
    door = oven @ SE3.at(*HINGE) @ SE3.about((0, 0, -1), angle)
    x, y, z = door.apply([BAR[0] + 0.030, BAR[1] + 0.020, 0.15 - HEIGHT / 2])
    yaw = oven.yaw + 0.9 - 0.7 * angle
    return down(x, y, z, yaw=yaw, tilt=0.8) @ SE3.at(yaw=math.pi / 2)


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
    clear = not sim.contacts.between("cube", DOOR)
    return inside and on_floor and clear and left_alone(sim, "cube")


way = ways_to(put_in, done, Putting())


HOOK = Putting(hooked=True, aslant=-1.2, below=1.2, bar_height=0.16)
WAYS: tuple[Way, ...] = (
    way("the door opened to 0.92 rad", Putting(angle=0.92)),
    way("the door opened to 1.4 rad", Putting(angle=1.4)),
    way("the door opened to 1.8 rad", Putting(angle=1.8)),
    way("closed fingers hook the bar", HOOK),
    way("a hand holds the door from inside", script=from_inside),
    way("the bar is held low", Putting(bar_height=0.13)),
    way("on the left of the floor", Putting(place=(0.06, 0.06), azimuth=0.0, slope=0.95)),
    way("on the right of the floor", Putting(place=(0.06, -0.11))),
    way("at the back of the floor", Putting(place=(0.18, 0.0), slope=1.15)),
    way("let go 25 mm above the floor", Putting(drop=0.025)),
    way("let go 40 mm above the floor", Putting(drop=0.040)),
    way("let go 50 mm above the floor", Putting(drop=0.050, slope=1.0)),
    way("set on the sill and pushed in", script=over_the_sill),
    way("pressed on the floor", Putting(drop=-0.004)),
    way("a flat hand", Putting(slope=1.2)),
    way("a steep hand", Putting(slope=0.6, place=(0.04, -0.05))),
    way("grasped deep in the fingers", Putting(grasp=0.022)),
    way("grasped with the tips", Putting(grasp=0.036)),
    way("trembling", tremble=0.01),
    way("half the speed", slowness=2),
)


def sample(rng: np.random.Generator) -> Way:
    """A way at random."""
    depth = rng.uniform(0.03, 0.18)
    hooked = bool(rng.random() < 0.3)
    how = Putting(
        angle=rng.uniform(0.92, 1.8),
        hooked=hooked,
        aslant=HOOK.aslant if hooked else rng.uniform(-1.2, -1.0),
        below=HOOK.below if hooked else rng.uniform(1.65, 1.85),
        # Higher, the hooked hand comes to the end of its arm.
        bar_height=rng.uniform(0.14, 0.17 if hooked else 0.20),
        grasp=rng.uniform(0.022, 0.036),
        grasp_tilt=rng.uniform(0.0, 0.3),
        place=(depth, rng.uniform(-0.11, 0.06)),
        drop=rng.uniform(-0.004, 0.050),
        slope=0.75 + 2.0 * depth + rng.uniform(0.0, 0.15),
        azimuth=rng.uniform(-0.3, 0.1),
    )
    tremble, slowness = (0.01 if rng.random() < 0.2 else 0.0), (2 if rng.random() < 0.15 else 1)
    return way(how=how, tremble=tremble, slowness=slowness)
