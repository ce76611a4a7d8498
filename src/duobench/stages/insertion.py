"""Pegs in sockets: the predicate `inserted`, for pegs and sockets on any two bodies."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.stages.predicates import Predicate, StateView
from duobench.types import Array

MAX_ANGLE = math.radians(10.0)
"""Largest angle between the axes of an inserted peg and its socket [task definitions]."""
MAX_OFFSET = 0.004
"""Largest lateral distance of an inserted peg's tip from the socket's axis, in metres [task
definitions]."""
MAX_DEPTH = 0.030
"""Depth in metres at which a tip has left any socket of the benchmark on its far side."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Port:
    """An end of a peg, or the mouth of a socket, on a body."""

    body: str
    """Body that carries it."""
    pose: SE3
    """Frame in the body: origin at the peg's tip or the socket's mouth, z pointing outwards."""

    @property
    def reach(self) -> float:
        """Distance in metres from the body's origin."""
        return math.hypot(*self.pose.translation.tolist())

    def axis(self, simulation: Simulation) -> np.ndarray:
        """Outward direction (3,) in the table frame."""
        return simulation.rotation(self.body) @ self.pose.rotation[:, 2]

    def position(self, simulation: Simulation) -> np.ndarray:
        """Position (3,) in the table frame, in metres."""
        return simulation.rotation(self.body) @ self.pose.translation + simulation.position(
            self.body
        )


def is_far(simulation: Simulation, peg: Port, socket: Port, distance: float) -> bool:
    """Whether a peg's tip is further than `distance` metres from a socket's mouth for certain.

    Costs a tenth of the exact question, and is the answer at most steps of an episode.
    """
    centre = simulation.relative_position(peg.body, socket.body)
    return math.dist(centre, socket.pose.translation.tolist()) > distance + peg.reach


def tip_offset(simulation: Simulation, peg: Port, socket: Port) -> tuple[float, Array]:
    """Where a peg's tip is from a socket's mouth, in metres: how far outside, and aside (3,)."""
    outwards = socket.axis(simulation)
    offset = peg.position(simulation) - socket.position(simulation)
    height = float(offset @ outwards)
    return height, offset - height * outwards


def inserted(peg: Port, socket: Port, depth: float) -> Predicate:
    """The peg is in the socket: aligned, and its tip on the axis, deep enough and not beyond.

    The bounds are `MAX_ANGLE`, `MAX_OFFSET` and `MAX_DEPTH`.

    Args:
        peg: Tip of the peg.
        socket: Mouth of the socket.
        depth: How far inside the mouth the tip is at least, in metres.
    """
    furthest = math.hypot(MAX_DEPTH, MAX_OFFSET)

    def test(m: StateView) -> bool:
        sim = m.simulation
        if is_far(sim, peg, socket, furthest):
            return False
        if float(peg.axis(sim) @ socket.axis(sim)) > -math.cos(MAX_ANGLE):
            return False
        height, aside = tip_offset(sim, peg, socket)
        return -MAX_DEPTH <= height <= -depth and float(np.linalg.norm(aside)) <= MAX_OFFSET

    return Predicate(f"peg of {peg.body} is {depth * 1000:.0f} mm inside {socket.body}", test)
