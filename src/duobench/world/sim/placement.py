"""Checks of layouts against the real geometry: overlaps, reach, the robot at home."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import TYPE_CHECKING

from duobench.core.errors import LayoutError
from duobench.core.types import SIDES
from duobench.world.sim.layout import Layout

if TYPE_CHECKING:
    from duobench.world.sim.simulation import Simulation

MAX_SAMPLES = 200
"""Layouts that a reset tries before it gives up."""
MAX_OVERLAP = 0.001
"""Deepest contact, in metres, that counts as standing on rather than overlapping."""
REACH_X = (0.15, 1.05)
REACH_Y = (-0.65, 0.65)
"""Where an object may start on the table, in metres [facts of the platform]."""
MAX_HEIGHT = 0.5
"""Highest lowest point of an object at the start, above the table in metres: below the grippers at
home, and above any stack. What is higher was given in another unit."""


def problems(simulation: Simulation, layout: Layout) -> list[str]:
    """What is wrong with a layout: overlaps, contact with the robot, below or beside the table.

    The simulation is left in the layout, with the arms at home.
    """
    simulation.reset_data()
    simulation.apply(layout)
    faults = [
        f"{one} and {other} overlap by {depth * 1000:.1f} mm"
        for one, other, depth in simulation.contacts.deepest(MAX_OVERLAP)
    ]
    for name in simulation.props:
        touching = simulation.contacts.partners(name)
        if any(owner.startswith(f"{side}/") for owner in touching for side in SIDES):
            faults.append(f"{name} touches the robot at home")
        x, y, _ = layout.poses[name].translation
        if not (REACH_X[0] <= x <= REACH_X[1] and REACH_Y[0] <= y <= REACH_Y[1]):
            faults.append(f"{name} is out of reach at ({x:.3f}, {y:.3f})")
        height = simulation.min_height(name)
        if height < -MAX_OVERLAP:
            faults.append(f"{name} is below the table top")
        if height > MAX_HEIGHT:
            faults.append(f"{name} is {height:g} m above the table, more than {MAX_HEIGHT} m")
    return faults


def first_valid(simulation: Simulation, candidates: Iterator[Layout], task: str) -> Layout:
    """The first of at most `MAX_SAMPLES` candidates that has no problems.

    The simulation is left in that layout, with the arms at home.
    """
    faults: list[str] = []
    tried = 0
    for tried, layout in enumerate(islice(candidates, MAX_SAMPLES), 1):  # noqa: B007 - told below
        faults = problems(simulation, layout)
        if not faults:
            return layout
    which = f"the last of {tried} samples" if tried > 1 else "the given one"
    raise LayoutError(
        f"Task {task!r} has no valid layout; {which} has these problems: {'; '.join(faults)}. "
        "Move the objects apart, widen their placements or shrink them."
    )
