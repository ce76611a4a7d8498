"""Vessels: conditions for lying in a bowl that stands on the table."""

import math
from dataclasses import dataclass
from math import inf

from duobench.tasks.stages.logic import Predicate, all_of
from duobench.tasks.stages.placing import (
    DROP_HEIGHT,
    lifted_off,
    low_over,
    put,
)
from duobench.tasks.stages.predicates import (
    CylinderRegion,
    inside,
    still,
    touching,
    upright,
)
from duobench.world.scene.naming import TABLE

STANDING_TILT_DEGREES = 20.0
"""Largest tilt of a vessel that stands [task definitions]."""


def stands_upright(body: str) -> Predicate:
    """A vessel stands upright on the table: it is not carried, tipped or on the floor."""
    return touching(body, TABLE) & upright(body, math.radians(STANDING_TILT_DEGREES))


@dataclass(frozen=True, kw_only=True, slots=True)
class Vessel:
    """A round vessel; its frame is under its middle, z up."""

    body: str
    radius: float
    """Radius of its inside in metres."""
    rim: float
    """Height of its rim in metres."""
    floor: float
    """Height of its floor, what lies in it lies on, in metres."""

    def over(self, prop: str) -> Predicate:
        """The prop is in it, or so little above its rim that it is put in when it is let go."""
        return inside(prop, self._region(inf)) & low_over(
            prop, self.body, self.rim, DROP_HEIGHT
        )

    def holds(self, prop: str) -> Predicate:
        """The prop lies still in it, and it stands; what flies through or hangs above does not."""
        whole = all_of(
            touching(prop, self.body),
            inside(prop, self._region(self.rim)),
            still(prop),
            stands_upright(self.body),
        )
        return whole.called(f"{prop} lies in {self.body}")

    def received(self, prop: str) -> Predicate:
        """It holds the prop, which a hand has put there: it was not dropped from above."""
        again = lifted_off(prop, self.body, self.floor)
        received = self.holds(prop) & put(prop, self.over(prop), again=again)
        return received.called(f"{prop} was put into {self.body}")

    def _region(self, high: float) -> CylinderRegion:
        return CylinderRegion(
            body=self.body,
            radius=self.radius,
            low=0.0,
            high=high,
        )
