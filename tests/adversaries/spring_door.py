"""How one might cheat in spring_door."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import chain

from duobench.experts.handling import LET_GO
from duobench.experts.motion import (
    CLOSED,
    Arms,
    Script,
    down,
    follow,
    grip,
    move,
    release,
    together,
    wait,
    wait_until,
)
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
from tests.adversaries.adversary import Adversary, Hands

DOOR = "microwave/door"
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
    yield from move(arms, {INSERTER: shut @ SE3.at(z=-0.12)}, tolerance=0.02)
    yield from move(arms, {INSERTER: shut}, speed=0.15)
    yield from follow(arms, lambda f: {INSERTER: _hook(oven, f * _DRAGGED)}, 3.0)
    yield from wait(30)


def one_arm(arms: Arms) -> Script:
    """One arm picks up the cube and drags the door open with its knuckles."""
    yield from fetch(arms)
    yield from _drag(arms)


def _let_go_of_the_door(arms: Arms) -> Script:
    yield from release(arms, HOLDER)
    yield from move(arms, {HOLDER: arms.targets[HOLDER] @ SE3.at(z=-0.12)})


def one_after_the_other(arms: Arms) -> Script:
    """The left arm opens the door and leaves; then the right arm drags it open with the cube."""
    yield from open_door(arms)
    yield from _let_go_of_the_door(arms)
    yield from wait_until(lambda: arms.sim.angle(DOOR) < 0.01, 90)
    yield from one_arm(arms)


def _tap(arms: Arms) -> Script:
    """The left hand comes to the open door from outside, touches it, and leaves."""
    oven = arms.sim.pose("microwave")
    near = at_bar(oven, _DRAGGED) @ SE3.at(z=-0.12)
    yield from grip(arms, HOLDER, opening=CLOSED)
    yield from move(arms, {HOLDER: near}, tolerance=0.02)
    yield from wait_until(lambda: arms.sim.angle(DOOR) >= _TAP_ANGLE, 400)
    step = near
    for _ in range(60):
        if arms.sim.contacts.gripper(HOLDER, DOOR):
            break
        step = step @ SE3.at(z=0.004)
        arms.targets[HOLDER] = step
        yield
    yield from move(arms, {HOLDER: near}, arrive=False)


def a_tap_of_the_other_hand(arms: Arms) -> Script:
    """One arm does all of it, and the other one touches the open door for a moment."""
    yield from together(one_arm(arms), _tap(arms))


def _hold_and_fetch(arms: Arms) -> Script:
    """What is honest up to stage 2."""
    yield from together(open_door(arms), fetch(arms))
    yield from wait(20)


def come_to_the_door(arms: Arms) -> Script:
    """The hand with the cube stops in the doorway, on the side of the hinge."""
    near = in_oven(arms) @ SE3.at(z=-0.09)
    yield from move(arms, {INSERTER: near.moved(y=0.05)}, tolerance=0.012)


def door_let_fall_on_the_arm(arms: Arms) -> Script:
    """The left arm leaves when the right hand is at the door; the door leans on that arm."""
    yield from _hold_and_fetch(arms)
    yield from come_to_the_door(arms)
    yield from _let_go_of_the_door(arms)
    yield from wait(20)
    yield from reach_in(arms)
    yield from release(arms, INSERTER, opening=LET_GO)


def _insert(arms: Arms) -> Script:
    yield from reach_in(arms)
    yield from release(arms, INSERTER, opening=LET_GO)


def _take_the_door_again(arms: Arms) -> Script:
    """The left hand grasps the bar and takes the door off the other arm, which leaves."""
    oven, angle = arms.sim.pose("microwave"), arms.sim.angle(DOOR)
    arms.openings[HOLDER.index] = _AROUND_THE_BAR
    again = at_bar(oven, angle)
    yield from move(arms, {HOLDER: again @ SE3.at(z=-0.05)}, speed=0.6, arrive=False)
    yield from move(arms, {HOLDER: again}, speed=0.5, arrive=False)
    yield from grip(arms, HOLDER)
    wider = max(0.0, _DRAGGED - angle)
    yield from follow(arms, lambda f: {HOLDER: at_bar(oven, angle + f * wider)}, 1.0)
    back = arms.targets[INSERTER] @ SE3.at(z=-0.12)
    yield from move(arms, {INSERTER: back}, arrive=False)
    yield from move(arms, {INSERTER: back.moved(x=-0.15, y=-0.3)}, tolerance=0.02)


def holder_away_while_the_cube_goes_in(arms: Arms) -> Script:
    """The left hand leaves the door to the other arm, and takes the handle again afterwards."""
    yield from _hold_and_fetch(arms)
    yield from come_to_the_door(arms)
    yield from release(arms, HOLDER)
    yield from move(arms, {HOLDER: arms.targets[HOLDER] @ SE3.at(z=-0.05)}, speed=0.5, arrive=False)
    yield from wait(10)
    yield from _insert(arms)
    yield from _take_the_door_again(arms)


def pressed_shut(by: float) -> Callable[[Arms], Script]:
    """The left hand opens its fingers around the bar and goes back, so that it presses the door
    shut from outside, while the other arm holds it open; it takes the bar again afterwards.

    Args:
        by: How far it goes back, in radians of the door.
    """

    def script(arms: Arms) -> Script:
        yield from _hold_and_fetch(arms)
        yield from come_to_the_door(arms)
        oven, angle = arms.sim.pose("microwave"), arms.sim.angle(DOOR)
        yield from release(arms, HOLDER, opening=_AROUND_THE_BAR)
        yield from follow(arms, lambda f: {HOLDER: at_bar(oven, angle - f * by)}, 0.6)
        yield from wait(20)
        yield from _insert(arms)
        yield from _take_the_door_again(arms)

    return script


def tapping(arms: Arms) -> Script:
    """The left hand leaves the bar and taps at it from outside every half second."""
    yield from _hold_and_fetch(arms)
    yield from come_to_the_door(arms)
    oven, angle = arms.sim.pose("microwave"), arms.sim.angle(DOOR)
    yield from release(arms, HOLDER, opening=_AROUND_THE_BAR)
    for number, _ in enumerate(chain(wait(20), _insert(arms))):
        back = 0.3 if number % 15 < _TAP_STEPS else 0.05
        arms.targets[HOLDER] = at_bar(oven, angle - back)
        yield
    yield from _take_the_door_again(arms)


def from_on_high(arms: Arms) -> Script:
    """The cube is let go as high above the floor as the roof lets the hand."""
    yield from _hold_and_fetch(arms)
    high = in_oven(arms).moved(z=_UNDER_THE_ROOF)
    yield from move(arms, {INSERTER: high @ SE3.at(z=-0.10)}, tolerance=0.02)
    yield from move(arms, {INSERTER: high}, speed=0.1)
    yield from release(arms, INSERTER, opening=LET_GO)


def _held_open_at_last(sim: Simulation) -> bool:
    """The cube is in, and the left hand alone holds the door."""
    held = sim.contacts.gripper(HOLDER, DOOR) and not sim.contacts.arm(INSERTER, DOOR)
    return held and sim.angle(DOOR) >= OPEN_ANGLE and _is_in(sim)


def cube_wedged_in_the_door(arms: Arms) -> Script:
    """The cube is put down across the front, and the door falls against it."""
    yield from _hold_and_fetch(arms)
    yield from reach_in(arms, depth=-0.07)
    yield from release(arms, INSERTER, opening=LET_GO)
    back = arms.targets[INSERTER] @ SE3.at(z=-0.12)
    yield from move(arms, {INSERTER: back}, arrive=False)
    yield from move(arms, {INSERTER: back.moved(x=-0.15, y=-0.35)}, tolerance=0.02)
    yield from _let_go_of_the_door(arms)
    yield from wait(60)


def in_and_out_again(arms: Arms) -> Script:
    """The cube is pressed on the floor of the cavity and taken out again, never let go."""
    yield from _hold_and_fetch(arms)
    yield from reach_in(arms)
    low = arms.targets[INSERTER].moved(z=-0.012)
    yield from move(arms, {INSERTER: low}, speed=0.1)
    yield from wait(15)
    yield from move(arms, {INSERTER: in_oven(arms) @ SE3.at(z=-0.15)})


def _dragged_open(sim: Simulation) -> bool:
    """The door is open, and the hand that holds the cube is what holds it open."""
    lone = sim.contacts.arm(INSERTER, DOOR) and sim.contacts.grasped(INSERTER, "cube")
    return lone and not sim.contacts.arm(HOLDER, DOOR) and sim.angle(DOOR) >= OPEN_ANGLE


def _tapped(sim: Simulation) -> bool:
    touched = sim.contacts.gripper(HOLDER, DOOR) and sim.contacts.grasped(INSERTER, "cube")
    return touched and sim.angle(DOOR) >= OPEN_ANGLE


def _is_in(sim: Simulation) -> bool:
    free = not any(sim.contacts.gripper(side, "cube") for side in (HOLDER, INSERTER))
    return free and FLOOR_REGION.contains(sim.relative_position("cube", "microwave"))


def _wedged(sim: Simulation) -> bool:
    return sim.contacts.between("cube", DOOR) and sim.contacts.between("cube", "microwave")


def _pinched_inside(sim: Simulation) -> bool:
    inner = FLOOR_REGION.contains(sim.relative_position("cube", "microwave"))
    on_floor = sim.contacts.between("cube", "microwave")
    return inner and on_floor and sim.contacts.grasped(INSERTER, "cube")


cheat = partial(Adversary, deed=_dragged_open)
ADVERSARIES: tuple[Adversary, ...] = (
    cheat(
        "one arm drags the door open with its knuckles while it holds the cube",
        one_arm,
        1,
        hands=Hands.ONE,
    ),
    cheat(
        "one arm opens the door and leaves, the other one drags it open with the cube",
        one_after_the_other,
        1,
        hands=Hands.TURNS,
    ),
    cheat("the other hand touches the door for a moment", a_tap_of_the_other_hand, 1, deed=_tapped),
    cheat(
        "the door is let fall on the arm with the cube", door_let_fall_on_the_arm, 2, deed=_is_in
    ),
    cheat(
        "the hand that holds the door is away while the cube goes in",
        holder_away_while_the_cube_goes_in,
        2,
        deed=_held_open_at_last,
    ),
    *(
        cheat(
            f"the hand that holds the door presses it shut by {by:.2f} rad while the cube goes in",
            pressed_shut(by),
            2,
            deed=_held_open_at_last,
        )
        for by in (0.16, 0.24, 0.30)
    ),
    cheat(
        "the hand that holds the door taps at it from outside while the cube goes in",
        tapping,
        2,
        deed=_held_open_at_last,
    ),
    cheat(
        "the cube is let go high above the floor",
        from_on_high,
        2,
        deed=_is_in,
        lacks="when cube was let go: cube is ",
    ),
    cheat(
        "the cube is wedged in the door",
        cube_wedged_in_the_door,
        2,
        deed=_wedged,
        lacks="cube touches microwave/door",
    ),
    cheat("the cube is put in and taken out again", in_and_out_again, 2, deed=_pinched_inside),
)
