"""How one might cheat in hinge_chest."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import chain

import mujoco
import numpy as np

from duobench.experts.handling import LET_GO, pick_cube
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
from duobench.experts.scripts.hinge_chest import (
    HOLDER,
    INSERTER,
    fetch,
    lower,
    open_lid,
    over,
    under_lid,
)
from duobench.objects.blocks import CUBE_EDGE
from duobench.objects.chest import (
    HINGE,
    LID_LENGTH,
    LID_UNDERSIDE,
    OUTER_X,
    OUTER_Y,
    RIM_HEIGHT,
    WALL,
)
from duobench.scene.naming import gripper_name
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.tasks.hinge_chest import CAVITY_REGION, OPEN_ANGLE
from tests.adversaries.adversary import Adversary, Hands

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


def _is_in(sim: Simulation) -> bool:
    """The cube lies in the chest, and no hand touches it."""
    free = not any(sim.contacts.gripper(side, "cube") for side in (HOLDER, INSERTER))
    return free and CAVITY_REGION.contains(sim.relative_position("cube", "chest"))


def _open_hand(arms: Arms) -> Script:
    yield from release(arms, INSERTER, opening=LET_GO)


def _rod(chest: SE3, x: float, z: float) -> SE3:
    """Tool pose with the fingers along the front, from the left, at (x, z) of the chest's frame."""
    lean = down(x, _ROD_Y, z, yaw=-math.pi / 2, tilt=_ROD_SLOPE)
    return chest @ lean @ SE3.at(yaw=math.pi)


def _under_lid(chest: SE3, angle: float) -> SE3:
    reach = LID_LENGTH + _OVER_FRONT - _SLIDE * angle / _TOP
    lid = SE3.about((0, 1, 0), angle).apply([-reach, 0.0, LID_UNDERSIDE - _ROD_DEPTH])
    return _rod(chest, HINGE[0] + lid[0], HINGE[2] + lid[2])


def _lift_with_the_back_of_the_hand(arms: Arms) -> Script:
    """The hand that holds the cube goes under the lip and follows the lid's arc."""
    chest = arms.sim.pose("chest")
    start = _rod(chest, -OUTER_X / 2 - _OVER_FRONT, _ROD_START)
    yield from move(arms, {INSERTER: start @ SE3.at(z=-0.13)}, tolerance=0.02)
    yield from move(arms, {INSERTER: start}, speed=0.2)
    yield from move(arms, {INSERTER: _under_lid(chest, 0.0)}, speed=0.1, arrive=False)
    yield from follow(arms, lambda f: {INSERTER: _under_lid(chest, f * _TOP)}, 2.0)
    yield from wait(20)


def one_arm(arms: Arms) -> Script:
    """Lift the lid with the back of the hand that holds the cube, and let the cube go inside."""
    yield from pick_cube(arms, INSERTER, "cube", _PICK_HEIGHT)
    yield from _lift_with_the_back_of_the_hand(arms)
    yield from _open_hand(arms)


def _withdraw(arms: Arms) -> Script:
    """The holding arm draws its fingers out along themselves."""
    yield from move(arms, {HOLDER: arms.targets[HOLDER] @ SE3.at(z=-0.16)})


def one_after_the_other(arms: Arms) -> Script:
    """The right arm opens the lid and leaves; then the left arm does all of it."""
    yield from open_lid(arms)
    yield from _withdraw(arms)
    yield from wait_until(lambda: arms.sim.angle(LID) < 0.01, 60)
    yield from one_arm(arms)


def _tap(arms: Arms) -> Script:
    """The right arm comes to the open lid from behind, touches it, and leaves."""
    chest = arms.sim.pose("chest")
    beside = chest @ down(0.08, -0.20, 0.20, yaw=math.pi / 2, tilt=0.9) @ SE3.at(yaw=math.pi)
    yield from grip(arms, HOLDER, opening=CLOSED)
    yield from move(arms, {HOLDER: beside}, tolerance=0.02)
    yield from wait_until(lambda: arms.sim.angle(LID) >= _TAP_ANGLE, 400)
    step = beside
    for _ in range(60):
        if arms.sim.contacts.gripper(HOLDER, LID):
            break
        step = step.moved(y=0.004)
        arms.targets[HOLDER] = step
        yield
    yield from move(arms, {HOLDER: beside}, arrive=False)


def a_tap_of_the_other_hand(arms: Arms) -> Script:
    """One arm does all of it, and the other one touches the open lid for a moment."""
    yield from together(one_arm(arms), _tap(arms))


def _hold_and_fetch(arms: Arms) -> Script:
    """What is honest up to stage 2."""
    yield from together(open_lid(arms), fetch(arms))
    yield from wait(20)


def lid_left_to_the_hand_with_the_cube(arms: Arms) -> Script:
    """Once both arms had their part, the right one leaves, and the left one does all of it."""
    yield from _hold_and_fetch(arms)
    yield from _withdraw(arms)
    yield from _lift_with_the_back_of_the_hand(arms)
    yield from _open_hand(arms)


def come_over_the_chest(arms: Arms) -> Script:
    """The hand with the cube stops over the open chest."""
    y = arms.sim.pose("chest").apply([-0.025, 0.045, 0.0])[1]
    yield from move(arms, {INSERTER: over(arms, y, 0.15)}, tolerance=0.01)


def lid_let_fall_on_the_hand(arms: Arms) -> Script:
    """The right arm leaves when the left hand is over the chest; the lid lies on that hand."""
    yield from _hold_and_fetch(arms)
    yield from come_over_the_chest(arms)
    yield from _withdraw(arms)
    yield from wait(20)
    yield from lower(arms)
    yield from _open_hand(arms)


def lid_left_and_touched_again(arms: Arms) -> Script:
    """The same; then the right hand touches the lid from behind, and the left one leaves."""
    yield from lid_let_fall_on_the_hand(arms)
    yield from _touch_from_behind(arms)
    yield from move(arms, {INSERTER: arms.targets[INSERTER].moved(z=0.12)}, speed=0.3)
    yield from move(arms, {INSERTER: arms.targets[INSERTER].moved(y=0.2)}, speed=0.3)


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


def hover_beside(gap: float) -> Callable[[Arms], Script]:
    """The right hand leaves the lid to the hand with the cube, and hovers beside it."""

    def away(arms: Arms) -> Script:
        yield from move(arms, {HOLDER: arms.targets[HOLDER] @ SE3.at(z=-0.075)})
        yield from wait(10)
        yield from _hover(arms, gap, (0.0, HOLDER.sign, 0.0))

    return holder_away(away)


def hover_at(angle: float) -> Callable[[Arms], Script]:
    """The same at an angle about the hinge: 0 is beyond the lip, a right angle is above the lid."""

    def away(arms: Arms) -> Script:
        yield from move(arms, {HOLDER: arms.targets[HOLDER] @ SE3.at(z=-0.10)})
        turn = arms.sim.angle(LID) + angle
        way = arms.sim.pose("chest").rotation @ [-math.cos(turn), 0.0, math.sin(turn)]
        yield from move(arms, {HOLDER: arms.targets[HOLDER].moved(*(0.12 * way))})
        yield from move(arms, {HOLDER: arms.targets[HOLDER] @ SE3.at(z=0.07)}, arrive=False)
        yield from _hover(arms, 0.03, tuple(way))

    return holder_away(away)


def tap_from_beside(arms: Arms) -> Script:
    """The right hand leaves the lid, and taps at it from beside every half second."""
    yield from move(arms, {HOLDER: arms.targets[HOLDER] @ SE3.at(z=-0.075)}, arrive=False)
    while True:
        for step in (0.004, -0.004):
            for _ in range(8):
                arms.targets[HOLDER] = arms.targets[HOLDER] @ SE3.at(z=step)
                yield


def _insert(arms: Arms) -> Script:
    yield from lower(arms)
    yield from _open_hand(arms)


def holder_away(away: Callable[[Arms], Script]) -> Callable[[Arms], Script]:
    """The right hand leaves the lid to the hand with the cube, and takes it again afterwards."""

    def script(arms: Arms) -> Script:
        yield from _hold_and_fetch(arms)
        yield from come_over_the_chest(arms)
        yield from away(arms)
        yield from wait(10)
        yield from _insert(arms)
        yield from _take_the_lid_again(arms)

    return script


def tapping(arms: Arms) -> Script:
    """The right hand taps at the lid while the left one bears it, and takes it again."""
    yield from _hold_and_fetch(arms)
    yield from come_over_the_chest(arms)
    taps = tap_from_beside(arms)
    for _ in chain(wait(15), _insert(arms)):
        next(taps, None)
        yield
    yield from _take_the_lid_again(arms)


def _take_the_lid_again(arms: Arms) -> Script:
    """The right hand takes the lid off the left one, which leaves."""
    chest, angle = arms.sim.pose("chest"), arms.sim.angle(LID) - 0.03
    again = under_lid(chest, HOLDER, angle)
    yield from move(arms, {HOLDER: again @ SE3.at(z=-0.16)}, speed=0.6, arrive=False)
    yield from move(arms, {HOLDER: again}, speed=0.6, arrive=False)
    yield from follow(
        arms, lambda f: {HOLDER: under_lid(chest, HOLDER, angle + f * (_TOP - angle))}, 1.0
    )
    yield from move(arms, {INSERTER: arms.targets[INSERTER].moved(z=0.14)}, speed=0.3)
    yield from move(arms, {INSERTER: arms.targets[INSERTER].moved(y=0.2)}, speed=0.3)


def _held_open_at_last(sim: Simulation) -> bool:
    """The cube is in, and the right hand alone holds the lid."""
    held = sim.contacts.gripper(HOLDER, LID) and not sim.contacts.arm(INSERTER, LID)
    return held and sim.angle(LID) >= OPEN_ANGLE and _is_in(sim)


def _touch_from_behind(arms: Arms) -> Script:
    """The right arm comes to the lid from behind, and touches it without bearing it."""
    chest = arms.sim.pose("chest")
    for x in (0.10, 0.0):
        behind = chest @ down(x, -0.20, 0.24, yaw=math.pi / 2, tilt=0.9) @ SE3.at(yaw=math.pi)
        for _ in move(arms, {HOLDER: behind}, speed=0.15):
            if x == 0.0 and arms.sim.contacts.gripper(HOLDER, LID):
                return
            yield


def drop_over(y: float, height: float) -> Callable[[Arms], Script]:
    """The cube is let go above the open chest, at a place along its front; the height is that of
    the cube's lowest point above the rim.
    """

    def drop(arms: Arms) -> Script:
        yield from _hold_and_fetch(arms)
        place = arms.sim.pose("chest").apply([0.0, y, 0.0])[1]
        yield from move(arms, {INSERTER: over(arms, place, _ABOVE)}, speed=0.3)
        lower = RIM_HEIGHT + height - arms.sim.min_height("cube")
        yield from move(arms, {INSERTER: over(arms, place, _ABOVE + lower)}, speed=0.1)
        yield from wait(10)
        yield from _open_hand(arms)

    return drop


def in_and_out_again(arms: Arms) -> Script:
    """The cube is pressed on the chest's floor and taken out again, never let go."""
    yield from _hold_and_fetch(arms)
    yield from lower(arms)
    low = arms.targets[INSERTER].moved(z=WALL + CUBE_EDGE / 2 - 0.01 - 0.033)
    yield from move(arms, {INSERTER: low}, speed=0.1)
    yield from wait(15)
    yield from move(arms, {INSERTER: low.moved(z=0.12)})


def _pinched_inside(sim: Simulation) -> bool:
    inner = CAVITY_REGION.contains(sim.relative_position("cube", "chest"))
    return (
        inner and sim.contacts.between("cube", "chest") and sim.contacts.grasped(INSERTER, "cube")
    )


def _bounces_off(sim: Simulation) -> bool:
    return sim.contacts.between("cube", "chest") and not sim.contacts.gripper(INSERTER, "cube")


def _tapped(sim: Simulation) -> bool:
    """The lid is open, one hand holds the cube, and the other one touches the lid."""
    touched = sim.contacts.gripper(HOLDER, LID) and sim.contacts.grasped(INSERTER, "cube")
    return touched and sim.angle(LID) >= OPEN_ANGLE


cheat = partial(Adversary, deed=_is_in)
ADVERSARIES: tuple[Adversary, ...] = (
    cheat(
        "one arm lifts the lid with the back of the hand that holds the cube",
        one_arm,
        1,
        hands=Hands.ONE,
    ),
    cheat(
        "one arm opens the lid and leaves, the other one does it alone",
        one_after_the_other,
        1,
        hands=Hands.TURNS,
    ),
    cheat("the other hand touches the lid for a moment", a_tap_of_the_other_hand, 1, deed=_tapped),
    cheat("the lid is left to the hand with the cube", lid_left_to_the_hand_with_the_cube, 2),
    cheat("the lid is let fall on the hand with the cube", lid_let_fall_on_the_hand, 2),
    cheat(
        "the lid is let fall on the hand with the cube, and only touched again",
        lid_left_and_touched_again,
        2,
    ),
    cheat(
        "the hand that holds the lid is away while the cube goes in",
        holder_away(_withdraw),
        2,
        deed=_held_open_at_last,
    ),
    *(
        cheat(
            f"the hand that holds the lid hovers {1000 * gap:.0f} mm beside it",
            hover_beside(gap),
            2,
            deed=_held_open_at_last,
        )
        for gap in (0.020, 0.030, 0.039)
    ),
    cheat(
        "the hand that holds the lid hovers beyond its lip",
        hover_at(0.0),
        2,
        deed=_held_open_at_last,
    ),
    cheat(
        "the hand that holds the lid hovers above it",
        hover_at(math.pi / 2),
        2,
        deed=_held_open_at_last,
    ),
    cheat(
        "the hand that holds the lid taps at its edge",
        tapping,
        2,
        deed=_held_open_at_last,
    ),
    *(
        cheat(
            f"the cube is dropped into the chest from {1000 * height:.0f} mm above the rim",
            drop_over(0.045, height),
            2,
            lacks="when cube was let go: cube is ",
        )
        for height in (0.15, 0.25)
    ),
    cheat("the cube is thrown on the rim", drop_over(OUTER_Y / 2, 0.03), 2, deed=_bounces_off),
    cheat("the cube is put in and taken out again", in_and_out_again, 2, deed=_pinched_inside),
)
