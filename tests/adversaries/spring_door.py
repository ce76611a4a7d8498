"""How one might cheat in spring_door."""

from __future__ import annotations

import math
from itertools import chain

from duobench.experts.motion import Arms, Script, down, follow, grip, release, wait
from duobench.experts.scripts.spring_door import (
    HOLDER,
    INSERTER,
    at_bar,
    fetch,
    in_oven,
    open_door,
    reach_in,
)
from duobench.objects.microwave import BAR, HEIGHT, HINGE
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.tasks.spring_door import FLOOR_REGION, OPEN_ANGLE
from tests.adversaries.adversary import ONE, TURNS, Adversary, cheats
from tests.adversaries.opening import Opening
from tests.steps import at_once, back, by, do, pause, to

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


def _drag(arms: Arms) -> Script:
    """The hand that holds the cube drags the door open with its knuckles."""
    oven = arms.sim.pose("microwave")
    shut = _hook(oven, 0.0)
    yield from to(arms, INSERTER, shut @ SE3.at(z=-0.12), tolerance=0.02)
    yield from to(arms, INSERTER, shut, speed=0.15)
    yield from follow(arms, lambda f: {INSERTER: _hook(oven, f * _DRAGGED)}, 3.0)
    yield from wait(30)


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
    """The left hand opens its fingers around the bar and goes back, so that it presses the door
    shut from outside, while the other arm holds it open.

    Args:
        arms: The arms.
        by: How far it goes back, in radians of the door.
    """
    oven, angle = arms.sim.pose("microwave"), arms.sim.angle(DOOR.lid)
    yield from release(arms, HOLDER, opening=_AROUND_THE_BAR)
    yield from follow(arms, lambda f: {HOLDER: at_bar(oven, angle - f * by)}, 0.6)
    yield from wait(20)


def tapping(arms: Arms) -> Script:
    """The left hand leaves the bar and taps at it from outside every half second."""
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
    """The right hand leaves the oven."""
    out = arms.targets[INSERTER] @ SE3.at(z=-0.12)
    yield from to(arms, INSERTER, out, arrive=False)
    yield from to(arms, INSERTER, out.moved(x=-0.15, y=y), tolerance=0.02)


def in_and_out_again(arms: Arms) -> Script:
    """The cube is pressed on the floor of the cavity and taken out again, never let go."""
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
ALONE = do(fetch, _drag)
BOTH, NEAR = DOOR.hold_and_fetch, come_to_the_door
IN, AGAIN = {"deed": DOOR.is_in}, _take_the_door_again
cheat, HELD = cheats(_dragged_open), {"deed": DOOR.held_open_at_last}
ADVERSARIES: tuple[Adversary, ...] = (
    cheat("one arm drags the door open with its knuckles while it holds the cube", 1, ALONE, **ONE),
    cheat(
        "one arm opens the door and leaves, the other one drags it open with the cube",
        1,
        *(open_door, LEAVE, (DOOR.shut, 90), ALONE),
        **TURNS,
    ),
    cheat(
        "the other hand touches the door for a moment", 1, (at_once, ALONE, _tap), deed=DOOR.tapped
    ),
    cheat(
        "the door is let fall on the arm with the cube",
        2,
        *(BOTH, NEAR, LEAVE, (pause, 20), DOOR.insert),
        **IN,
    ),
    cheat(
        "the hand that holds the door is away while the cube goes in",
        2,
        *(BOTH, NEAR, (release, HOLDER), (back, HOLDER, 0.05, {"speed": 0.5, "arrive": False})),
        *((pause, 10), DOOR.insert, AGAIN),
        **HELD,
    ),
    *(
        cheat(
            f"the hand that holds the door presses it shut by {by:.2f} rad while the cube goes in",
            2,
            *(BOTH, NEAR, (press_shut, by), DOOR.insert, AGAIN),
            **HELD,
        )
        for by in (0.16, 0.24, 0.30)
    ),
    cheat(
        "the hand that holds the door taps at it from outside while the cube goes in",
        2,
        *(BOTH, NEAR, tapping, AGAIN),
        **HELD,
    ),
    cheat(
        "the cube is let go high above the floor",
        2,
        *(BOTH, from_on_high),
        **IN,
        lacks="when cube was let go: cube is ",
    ),
    cheat(
        "the cube is wedged in the door",
        2,
        *(BOTH, (reach_in, {"depth": -0.07}), DOOR.let_go, (withdraw, -0.35), LEAVE, (pause, 60)),
        deed=_wedged,
        lacks="cube touches microwave/door",
    ),
    cheat(
        "the cube is put in and taken out again",
        2,
        *(BOTH, in_and_out_again),
        deed=DOOR.pinched_inside,
    ),
)
