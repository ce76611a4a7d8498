"""Seeded variety of scripted experts: how an episode's motion differs from the plain script.

A script moves in the same way whenever it starts in the same layout. Demonstrations of that kind
show a policy one narrow path and never how to come back to it. So an expert can be given a
variety: other speeds, curved ways, pauses, shifted grasps, and noise in the executed action, while
the intended action stays the label (DART, Laskey et al. 2017).

All of it goes through the action space, and follows from (task, seed that the expert is reset with,
name of the variety) alone. How much a motion differs is scaled by its freedom, 0 to 1, which falls
with the speed that the script chose: what a script does slowly, it does precisely.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from duobench.core.randomness import Uniform, around, variety_generator
from duobench.core.spatial import SE3
from duobench.core.types import (
    ARM_JOINTS,
    CONTROL_HZ,
    SIDES,
    Array,
    Side,
)

STRAIGHT = 0.10
"""Ways up to this length, in metres, stay straight: approaches, lifts, retreats."""
NOISE_SECONDS = 0.4
"""Time in which the noise forgets itself: long enough to lead a tool off its way and back."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Variety:
    """Ranges that an episode's differences are sampled from; the defaults are no difference."""

    name: str
    tempo: Uniform = Uniform(1.0, 1.0)
    """Factor on the speed of a whole episode."""
    speed: Uniform = Uniform(1.0, 1.0)
    """Factor on the speed of each motion on top of that."""
    start_delay: Uniform = Uniform(0.0, 0.0)
    """Seconds before the first motion of each arm."""
    pause_chance: float = 0.0
    """Probability of a pause before a free motion."""
    pause: Uniform = Uniform(0.0, 0.0)
    """Seconds of a pause."""
    detour: float = 0.0
    """Largest distance from the straight way, as a share of the length beyond `STRAIGHT`."""
    max_detour: float = 0.0
    """Largest distance from the straight way in metres."""
    grasp_shift: float = 0.0
    """Largest shift of a grasp across the direction in which the fingers close, in metres."""
    grasp_depth: float = 0.0
    """Largest shift of a grasp along the tool, in metres."""
    grasp_turn: float = 0.0
    """Largest turn of a grasp about the tool's axis and about the closing direction, in radians."""
    noise: float = 0.0
    """Standard deviation of the noise in each executed joint target, in radians."""
    swaps: bool = False
    """Whether the nearer arm goes first at what either can do. A drawn order would be a plan that
    nothing seen shows: who imitates both orders learns the middle of them."""


NONE = Variety(name="none")
HUMAN = Variety(
    name="human",
    tempo=Uniform(0.80, 1.15),
    speed=Uniform(0.85, 1.13),
    start_delay=Uniform(0.0, 0.6),
    pause_chance=0.15,
    pause=Uniform(0.1, 0.5),
    detour=0.25,
    max_detour=0.06,
    grasp_shift=0.005,
    grasp_depth=0.002,
    grasp_turn=math.radians(4.0),
    noise=0.012,
    swaps=True,
)
WIDE = Variety(
    name="wide",
    tempo=Uniform(0.70, 1.10),
    speed=Uniform(0.86, 1.18),
    start_delay=Uniform(0.0, 1.0),
    pause_chance=0.25,
    pause=Uniform(0.1, 0.8),
    detour=0.40,
    max_detour=0.10,
    grasp_shift=0.007,
    grasp_depth=0.003,
    grasp_turn=math.radians(6.0),
    noise=0.025,
    swaps=True,
)
VARIETIES: Mapping[str, Variety] = {v.name: v for v in (NONE, HUMAN, WIDE)}
"""Every variety by name."""


class VarietySample:
    """Variations of one episode, sampled as its script asks for it."""

    def __init__(
        self, variety: Variety = NONE, task_id: str = "", seed: int = 0
    ) -> None:
        self.variety = variety
        self._rng = variety_generator(task_id, seed, variety.name, "motion")
        self._noise_rng = variety_generator(task_id, seed, variety.name, "noise")
        self._noise = np.zeros((len(SIDES), ARM_JOINTS))
        self._tempo = variety.tempo.sample(self._rng)
        self._waiting = set(SIDES)

    def pace(self, freedom: float) -> float:
        """Factor on the speed of the next motion."""
        factor = self._tempo * self.variety.speed.sample(self._rng)
        return 1.0 + freedom * (factor - 1.0)

    def pause_steps(self, sides: Iterable[Side], freedom: float) -> int:
        """Control steps to wait before the next motion of some arms."""
        begins = not self._waiting.isdisjoint(sides)
        self._waiting.difference_update(sides)
        if begins:
            return round(self.variety.start_delay.sample(self._rng) * CONTROL_HZ)
        if self._rng.random() >= self.variety.pause_chance * freedom:
            return 0
        return round(self.variety.pause.sample(self._rng) * CONTROL_HZ)

    def detour(self, way: Array, freedom: float) -> Array:
        """Detour of the middle of a way to one side of it, and not down.

        Args:
            way: From start to goal (3,), in metres.
            freedom: Freedom of the motion, 0 to 1.

        Returns:
            Shift (3,) in metres, at right angles to the way.
        """
        length = float(np.linalg.norm(way))
        share = self.variety.detour * max(0.0, length - STRAIGHT)
        size = (
            freedom * min(share, self.variety.max_detour) * self._rng.uniform(0.2, 1.0)
        )
        direction = self._rng.normal(size=3)
        if size == 0.0:
            return np.zeros(3)
        direction -= (direction @ way) * way / length**2
        return math.copysign(size, direction[2]) * direction / np.linalg.norm(direction)

    def grasp_offset(self, freedom: float) -> SE3:
        """Pose of a grasp in the frame of the tool that would grasp as the script says."""
        v = self.variety
        halves = (v.grasp_shift, v.grasp_depth, v.grasp_turn, v.grasp_turn)
        x, z, yaw, tilt = (
            around(0.0, freedom * half).sample(self._rng) for half in halves
        )
        return SE3.at(
            x,
            0.0,
            z,
            yaw=yaw,
        ) @ SE3.about((0, 1, 0), tilt)

    def ordered(self, sides: tuple[Side, ...], y: float) -> tuple[Side, ...]:
        """Arms in the order in which they act, where the order is free.

        Args:
            sides: The arms, in the order of the script.
            y: Where on the table's y they act, in metres: the arm of that side is nearer.
        """
        if not self.variety.swaps:
            return sides
        return tuple(sorted(sides, key=lambda side: -side.sign * y))

    def disturbance(self, freedom: Array) -> Array:
        """Noise (2, 7) of the next executed joint targets in radians (Ornstein-Uhlenbeck process).

        Args:
            freedom: Freedom of each arm (2,) at this moment, 0 to 1.
        """
        kept = math.exp(-1.0 / (NOISE_SECONDS * CONTROL_HZ))
        fresh = self.variety.noise * self._noise_rng.normal(size=self._noise.shape)
        self._noise = kept * self._noise + math.sqrt(1.0 - kept**2) * fresh
        return freedom[:, None] * self._noise
