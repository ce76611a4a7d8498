"""Everything that is drawn: named distributions, and generators that depend on nothing else.

A generator is a pure function of (task, suite version, seed); an episode's seed is a pure function
of (task, suite version, episode index). Hashing makes neighbouring numbers unrelated and keeps the
result independent of the process, the platform and of what ran before.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass

import numpy as np

SUITE_VERSION = "3"
"""Version of the benchmark's episodes. A change that alters any layout or state raises it."""


def _digest(*words: object) -> int:
    text = "\x1f".join(map(str, words))
    return int.from_bytes(hashlib.sha256(text.encode()).digest(), "big")


def generator(task_id: str, seed: int) -> np.random.Generator:
    """Generator for one episode of a task; the same (task, suite version, seed), the same draws."""
    words = _digest("layout", task_id, SUITE_VERSION, int(seed))
    return np.random.Generator(np.random.PCG64(words))


def episode_seed(task_id: str, episode: int) -> int:
    """Seed (32 bits) of the n-th evaluation episode of a task in this suite version."""
    if episode < 0:
        raise ValueError(f"An episode index counts from 0, got {episode}.")
    return _digest("episode", task_id, SUITE_VERSION, int(episode)) % 2**32


@dataclass(frozen=True, slots=True)
class Uniform:
    """A number drawn uniformly from [low, high)."""

    low: float
    high: float

    def __post_init__(self) -> None:
        """Refuse an empty range."""
        if not self.low <= self.high:
            raise ValueError(f"Uniform needs low <= high, got {self.low} and {self.high}.")

    def draw(self, rng: np.random.Generator) -> float:
        """One number."""
        return float(rng.uniform(self.low, self.high))


def around(centre: float, half: float) -> Uniform:
    """Uniform within `half` of `centre`."""
    return Uniform(centre - half, centre + half)


ANY_YAW = Uniform(-math.pi, math.pi)
"""Any rotation about the vertical."""


@dataclass(frozen=True, slots=True)
class Choice:
    """One of several values, each equally likely."""

    options: tuple[str, ...]

    def draw(self, rng: np.random.Generator) -> str:
        """One of the options."""
        return self.options[int(rng.integers(len(self.options)))]
