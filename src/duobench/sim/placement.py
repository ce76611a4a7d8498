"""Layouts: where a task's props start, checked against the real geometry before they are used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import numpy as np

from duobench.errors import LayoutError
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.types import SIDES

MAX_DRAWS = 200
"""Layouts that a reset tries before it gives up."""
MAX_OVERLAP = 0.001
"""Deepest contact, in metres, that counts as standing on rather than overlapping."""
REACH_X = (0.15, 1.05)
REACH_Y = (-0.65, 0.65)
"""Where an object may start on the table, in metres [facts of the platform]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Layout:
    """How an episode starts; a value that is stored with it and can be given instead of a seed."""

    poses: Mapping[str, SE3]
    """Pose of every prop in the table frame."""
    variants: Mapping[str, str] = field(default_factory=dict)
    """Named choices, such as which cup holds the marbles."""

    def __post_init__(self) -> None:
        """Refuse a pose that is none."""
        for name, pose in self.poses.items():
            if not (np.isfinite(pose.rotation).all() and np.isfinite(pose.translation).all()):
                raise LayoutError(f"The pose of {name!r} is not finite: {pose.tquat.tolist()}.")

    def to_json(self) -> dict[str, Any]:
        """As plain data: poses as x y z qx qy qz qw."""
        return {
            "poses": {name: [float(v) for v in pose.tquat] for name, pose in self.poses.items()},
            "variants": dict(self.variants),
        }

    @staticmethod
    def from_json(data: Mapping[str, Any]) -> Layout:
        """From what `to_json` gave.

        Raises:
            LayoutError: A key is missing or a pose has not seven numbers.
        """
        try:
            poses = {name: SE3.from_tquat(values) for name, values in data["poses"].items()}
            return Layout(poses=poses, variants=dict(data.get("variants", {})))
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise LayoutError(
                f"This is no layout: {error!r}. A layout is "
                '{"poses": {object: [x, y, z, qx, qy, qz, qw]}, "variants": {name: value}}.'
            ) from error


def apply(simulation: Simulation, layout: Layout) -> None:
    """Put every prop where the layout says, at rest.

    Raises:
        LayoutError: The layout does not name exactly the props of the simulation.
    """
    given, needed = set(layout.poses), set(simulation.props)
    if given != needed:
        raise LayoutError(
            f"The layout must place exactly {sorted(needed)}: missing {sorted(needed - given)}, "
            f"unknown {sorted(given - needed)}."
        )
    for name, pose in layout.poses.items():
        simulation.place(name, pose)
    simulation.refresh()


def problems(simulation: Simulation, layout: Layout) -> list[str]:
    """What is wrong with a layout: overlaps, contact with the robot, below or beside the table.

    The simulation is left in the layout, with the arms at home.
    """
    simulation.clear()
    apply(simulation, layout)
    found = [
        f"{one} and {other} overlap by {depth * 1000:.1f} mm"
        for one, other, depth in simulation.contacts.deepest(MAX_OVERLAP)
    ]
    for name in simulation.props:
        touching = simulation.contacts.partners(name)
        if any(owner.startswith(f"{side}/") for owner in touching for side in SIDES):
            found.append(f"{name} touches the robot at home")
        x, y, _ = layout.poses[name].translation
        reachable = REACH_X[0] <= x <= REACH_X[1] and REACH_Y[0] <= y <= REACH_Y[1]
        if not reachable:
            found.append(f"{name} is out of reach at ({x:.3f}, {y:.3f})")
        if simulation.lowest(name) < -MAX_OVERLAP:
            found.append(f"{name} is below the table top")
    return found


def first_valid(simulation: Simulation, candidates: Iterator[Layout], task: str) -> Layout:
    """The first of at most `MAX_DRAWS` candidates that has no problems.

    Raises:
        LayoutError: None was valid; the message says what was wrong with the last one.
    """
    found: list[str] = ["no candidate was drawn"]
    for layout in islice(candidates, MAX_DRAWS):
        found = problems(simulation, layout)
        if not found:
            return layout
    raise LayoutError(
        f"No valid layout of {task!r} in {MAX_DRAWS} draws; the last one: {'; '.join(found)}. "
        "Widen the placements or shrink the objects."
    )
