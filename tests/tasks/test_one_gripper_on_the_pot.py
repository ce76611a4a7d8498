"""One gripper alone cannot carry the pot level, however it takes a handle."""

import math
from dataclasses import dataclass

import pytest

from duobench.experts.motion import Arms, Script, down, follow, grip, move, wait
from duobench.solids.pot import (
    HANDLE_OFFSET,
    HANDLE_Z,
    HINGE_OFFSET,
    HINGE_Z,
)
from duobench.spatial import SE3
from duobench.tasks.carry_pot import HANDLES, TASK
from duobench.types import Side
from tests.stageplay import Stageplay

LEVEL = math.radians(15)
BRIEFLY = 15
"""One gripper alone may have the pot off the table and level for half a second: the far edge of a
pot that begins to tip is off the table for a moment."""


@pytest.fixture(scope="module")
def bench() -> Stageplay:
    return Stageplay(TASK)


def off_ground(bench: Stageplay) -> bool:
    between = bench.sim.contacts.between
    return not any(between(b, s) for b in ("pot", *HANDLES) for s in ("table", "stove"))


def tilt(bench: Stageplay) -> float:
    return math.acos(min(1.0, bench.sim.rotation("pot")[2, 2]))


@dataclass(frozen=True, kw_only=True, slots=True)
class Grasp:
    """A way to take one handle, and to lift by it; in the handle's frame, its outside +y."""

    yaw: float = 0.0
    roll: float = 0.0
    lean: float = 0.0
    """Turns of the gripper about the vertical, about the bar, and about its own fingers' axis."""
    along: float = 0.0
    inward: float = 0.0
    up: float = 0.0
    """Where the fingers close, from the middle of the bar."""
    opening: float = 0.45
    fold: float = 0.0
    """How far the handle is folded outwards before the lift, in radians."""
    counter: float = 0.0
    """How far the gripper turns about the bar while it lifts, against the pot's tilt."""
    push: float = 0.0
    """How far it pushes towards the pot while it lifts."""
    speed: float = 0.1
    seed: int = 0

    def lift(self, arms: Arms, side: Side) -> Script:
        """Take the handle and lift it by 0.1 m."""
        turned = math.pi if side is Side.RIGHT else 0.0
        pot = arms.sim.pose("pot") @ SE3.at(yaw=turned)
        bar = (self.along, HANDLE_OFFSET - self.inward, HANDLE_Z + 0.004 + self.up)
        turn = SE3.about((1, 0, 0), self.roll) @ down(0, 0, 0, yaw=self.yaw, lean=self.lean)
        tool = pot @ SE3.at(*bar) @ turn @ SE3.at(yaw=turned)
        arms.openings[side.index] = self.opening
        yield from move(arms, {side: tool @ SE3.at(z=-0.1)}, tolerance=0.02)
        yield from move(arms, {side: tool}, speed=0.25)
        yield from grip(arms, side)

        def about(point: SE3, angle: float) -> SE3:
            return point @ SE3.about((1, 0, 0), angle) @ point.inverse()

        hinge = pot @ SE3.at(0, HINGE_OFFSET, HINGE_Z)
        fold = about(hinge, -self.fold)
        folded = fold @ tool
        centre = SE3(pot.rotation, (fold @ pot @ SE3.at(*bar)).translation)

        def path(fraction: float) -> dict[Side, SE3]:
            x, y, z = fraction * (pot.rotation @ (0.0, -self.push, 0.0))
            turned = about(centre, self.counter * fraction) @ folded
            return {side: turned.moved(x=x, y=y, z=z + 0.1 * fraction)}

        yield from follow(
            arms, lambda f: {side: about(hinge, -self.fold * f) @ tool}, 0.8 * self.fold
        )
        yield from follow(arms, path, 0.1 / self.speed)
        yield from wait(45)


GRASPS = {
    "bar": Grasp(),
    "end of the bar": Grasp(along=-0.025),
    "corner": Grasp(yaw=1.0, along=-0.045),
    "arm": Grasp(yaw=math.pi / 2, along=0.045, inward=0.016, up=-0.04),
    # What carries a pot level whose handles are fixed to its wall.
    "corner, turned": Grasp(yaw=0.91, roll=-0.16, along=-0.051, counter=-0.23, speed=0.04, seed=3),
    # What does where a stop keeps the handles from folding out.
    "bar, turned back": Grasp(
        yaw=-0.374,
        lean=-0.027,
        along=-0.01,
        inward=-0.009,
        up=-0.03,
        fold=0.217,
        counter=-0.648,
        push=-0.028,
        speed=0.243,
        seed=3,
    ),
    # What does with hinges above the pot's middle: fingertips push against the wall below them.
    "wall": Grasp(
        roll=-0.55,
        lean=-0.48,
        along=-0.029,
        inward=0.01,
        up=-0.015,
        opening=0.744,
        fold=0.724,
        counter=-0.442,
        speed=0.075,
        seed=3,
    ),
    # The best of three thousand that a search found for this pot.
    "bar, leaning": Grasp(
        yaw=0.606,
        lean=-0.461,
        along=-0.017,
        inward=-0.007,
        up=-0.008,
        opening=0.805,
        push=-0.019,
        speed=0.287,
        seed=3,
    ),
    "bar, turned": Grasp(
        yaw=-0.396,
        roll=-0.078,
        lean=-0.027,
        along=-0.01,
        inward=-0.009,
        up=-0.03,
        opening=0.395,
        counter=-0.472,
        push=-0.016,
        speed=0.243,
        seed=3,
    ),
}


@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize("grasp", GRASPS.values(), ids=GRASPS)
def test_one_gripper_cannot_carry_the_pot_level(bench: Stageplay, side: Side, grasp: Grasp) -> None:
    bench.start(grasp.seed)
    level, longest, most = 0, 0, 0.0
    for _ in grasp.lift(bench.arms, side):
        bench.advance()
        level = level + 1 if off_ground(bench) and tilt(bench) < LEVEL else 0
        longest, most = max(longest, level), max(most, tilt(bench))
    assert longest <= BRIEFLY
    assert most > LEVEL
    assert bench.stage == 1
