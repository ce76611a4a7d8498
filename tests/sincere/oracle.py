"""What a person sees at the end, of things that several tasks have: it asks physics alone."""

from __future__ import annotations

import math

from duobench.sim.simulation import Simulation
from duobench.types import SIDES

SLOW, TURNING_SLOWLY = 0.02, 0.3
"""Speeds in m/s and rad/s below which a person would say that a thing does not move."""


def left_alone(sim: Simulation, *props: str) -> bool:
    """No gripper touches any of them, and none moves."""
    for prop in props:
        if any(sim.contacts.gripper(side, prop) for side in SIDES):
            return False
        speed, turning = sim.speed(prop)
        if speed > SLOW or turning > TURNING_SLOWLY:
            return False
    return True


def tilt(sim: Simulation, prop: str) -> float:
    """Angle of its up axis against the world's, in radians."""
    return math.acos(min(1.0, max(-1.0, float(sim.rotation(prop)[2, 2]))))
