"""In a vessel: what counts as lying in a bowl that stands on the table."""

from __future__ import annotations

import math

from duobench.scene.naming import TABLE
from duobench.stages.predicates import (
    Predicate,
    Region,
    all_of,
    inside,
    still,
    touching,
    upright,
)

MAX_TILT = math.radians(20.0)
"""Largest tilt of a vessel that stands [task definitions]."""


def lies_in(prop: str, region: Region) -> Predicate:
    """It lies still in a vessel: inside it and touching it, and the vessel stands on the table.

    What flies through, hangs above, or lies in a vessel that is carried, tipped or on the floor
    does not.

    Args:
        prop: What lies.
        region: The inside of the vessel, fixed to its body.
    """
    vessel = region.body
    whole = all_of(
        touching(prop, vessel),
        inside(prop, region),
        still(prop),
        touching(vessel, TABLE),
        upright(vessel, MAX_TILT),
    )
    return Predicate(f"{prop} lies in {vessel}", whole.test, whole.parts)
