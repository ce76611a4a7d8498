"""What the chest with a lid and the oven with a door have in common: one arm holds it open, the
other one brings the cube.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from duobench.core.spatial import SE3
from duobench.core.types import SIDES, Side
from duobench.tasks.experts.handling import LET_GO
from duobench.tasks.experts.motion import (
    CLOSED,
    Arms,
    Script,
    grip,
    move,
    release,
    together,
    wait,
    wait_until,
)
from duobench.tasks.stages.predicates import BoxRegion
from duobench.world.sim.simulation import Simulation
from tests.steps import Act, do


@dataclass(frozen=True, kw_only=True)
class Opening:
    """A lid or a door, what honest arms do with it, and what adversaries bring about."""

    lid: str
    fixture: str
    region: BoxRegion
    """Where the cube belongs."""
    open_angle: float
    holder: Side
    opens: Act
    fetches: Act
    comes_near: Act
    puts_in: Act

    @property
    def bringer(self) -> Side:
        return self.holder.other

    def hold_and_fetch(self, arms: Arms) -> Script:
        """What is honest up to stage 2."""
        yield from together(self.opens(arms), self.fetches(arms))
        yield from wait(20)

    def shut(self, arms: Arms, max_steps: int) -> Script:
        yield from wait_until(lambda: arms.sim.angle(self.lid) < 0.01, max_steps)

    def let_go(self, arms: Arms) -> Script:
        yield from release(arms, self.bringer, opening=LET_GO)

    @property
    def insert(self) -> Act:
        return do(self.puts_in, self.let_go)

    def tap(self, arms: Arms, near: SE3, angle: float, onward: Callable[[SE3], SE3]) -> Script:
        """The holding hand comes to what is open, touches it for a moment, and leaves.

        It waits at a tool pose `near` it until this is open by an angle in radians, and goes
        `onward` from pose to pose, one a control step.
        """
        yield from grip(arms, self.holder, opening=CLOSED)
        yield from move(arms, {self.holder: near}, tolerance=0.02)
        yield from wait_until(lambda: arms.sim.angle(self.lid) >= angle, 400)
        step = near
        for _ in range(60):
            if arms.sim.contacts.gripper(self.holder, self.lid):
                break
            step = onward(step)
            arms.targets[self.holder] = step
            yield
        yield from move(arms, {self.holder: near}, arrive=False)

    # --- deeds ------------------------------------------------------------------------------------

    def is_inside(self, sim: Simulation) -> bool:
        return self.region.contains(sim.relative_position("cube", self.fixture))

    def is_in(self, sim: Simulation) -> bool:
        """The cube lies inside, and no hand touches it."""
        return not any(sim.contacts.gripper(side, "cube") for side in SIDES) and self.is_inside(sim)

    def held_open_at_last(self, sim: Simulation) -> bool:
        """The cube is in, and the holding hand alone holds the lid or the door."""
        contacts = sim.contacts
        held = contacts.gripper(self.holder, self.lid) and not contacts.arm(self.bringer, self.lid)
        return held and sim.angle(self.lid) >= self.open_angle and self.is_in(sim)

    def tapped(self, sim: Simulation) -> bool:
        """It is open, one hand holds the cube, and the other one touches it."""
        touched = sim.contacts.gripper(self.holder, self.lid)
        open_ = sim.angle(self.lid) >= self.open_angle
        return touched and open_ and sim.contacts.grasped(self.bringer, "cube")

    def pinched_inside(self, sim: Simulation) -> bool:
        on_floor = sim.contacts.between("cube", self.fixture)
        return self.is_inside(sim) and on_floor and sim.contacts.grasped(self.bringer, "cube")
