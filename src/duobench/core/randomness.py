"""Everything that is sampled: named distributions, and generators that depend on nothing else.

A layout's generator is a pure function of (task, suite version, split, seed); an episode's seed is
a pure function of (task, suite version, split, episode index), and what a policy is seeded with and
told in it of (task, suite version, split, seed). Hashing makes neighbouring numbers unrelated and
keeps the result independent of the process, the platform and of what ran before.
"""

import hashlib
import math
from dataclasses import dataclass

import numpy as np

from duobench.core.errors import TaskError, check_known

SUITE_VERSION = "6"
"""Version of the benchmark's episodes. A change that alters any layout or state raises it."""

EVAL, TRAIN = "eval", "train"
"""Splits: layouts that policies are evaluated on, and layouts that demonstrations begin with."""
SPLITS = (EVAL, TRAIN)


def _digest(*words: object) -> int:
    text = "\x1f".join(map(str, words))
    return int.from_bytes(hashlib.sha256(text.encode()).digest(), "big")


def _word(kind: str, split: str) -> str:
    # The first hashed word keeps the splits apart, so a layout in both would need two different
    # texts with the same SHA-256 hash.
    check_known("split", split, SPLITS)
    return kind if split == EVAL else f"{split} {kind}"


def layout_key(
    task_id: str,
    seed: int,
    split: str = EVAL,
) -> int:
    """Number (256 bits) that a layout follows from; distinct for all tasks, splits and seeds."""
    return _digest(_word("layout", split), task_id, SUITE_VERSION, int(seed))


def generator(
    task_id: str,
    seed: int,
    split: str = EVAL,
) -> np.random.Generator:
    """Generator of a layout; the same (task, suite version, split, seed), the same numbers."""
    return np.random.Generator(np.random.PCG64(layout_key(task_id, seed, split)))


def variety_generator(
    task_id: str, seed: int, variety: str, purpose: str
) -> np.random.Generator:
    """Generator of what an expert does differently in an episode; unrelated to the layout's.

    The seed is that which the expert is reset with; other purposes have unrelated numbers.
    """
    words = _digest("variety", task_id, int(seed), variety, purpose)
    return np.random.Generator(np.random.PCG64(words))


def shift_generator(
    task_id: str, seed: int, axis: str, split: str = EVAL
) -> np.random.Generator:
    """Generator of what an episode has along an axis of a shift; unrelated to the layout's.

    Seed and split are those of the layout; other axes have unrelated numbers.
    """
    words = _digest(_word("shift", split), task_id, SUITE_VERSION, int(seed), axis)
    return np.random.Generator(np.random.PCG64(words))


def episode_seed(
    task_id: str,
    episode: int,
    split: str = EVAL,
) -> int:
    """Seed (32 bits) of the n-th episode of a task's split in this suite version."""
    if episode < 0:
        raise ValueError(f"An episode index counts from 0, got {episode}.")
    return (
        _digest(_word("episode", split), task_id, SUITE_VERSION, int(episode)) % 2**32
    )


def policy_seed(
    task_id: str,
    seed: int,
    split: str = EVAL,
) -> int:
    """Seed (32 bits) that a policy gets in the episode of a seed.

    An environment that is reset with it shows another layout, so that no policy makes the layout of
    its episode again by accident, or with a simulator of its own. It is no secret: hashing
    all seeds of a suite, which are published, finds the one that it comes from. Seed and split are
    those of the layout.
    """
    return _digest(_word("policy", split), task_id, SUITE_VERSION, int(seed)) % 2**32


def instruction_number(
    task_id: str,
    seed: int,
    count: int,
    split: str = EVAL,
) -> int:
    """Number of the instruction of a seed's episode, from 0 to `count` - 1.

    Seed and split are those of the layout.
    """
    return (
        _digest(_word("instruction", split), task_id, SUITE_VERSION, int(seed)) % count
    )


def look_number(
    task_id: str,
    seed: int | None,
    file: str,
    number: int,
) -> int:
    """Seed (30 bits) of the random look of an exported episode.

    It follows from the seed of its layout (None if it was given), the name of its file, and a
    number that chooses among the looks of exports.
    """
    return _digest("export look", task_id, SUITE_VERSION, seed, file, number) % 2**30


@dataclass(frozen=True, slots=True)
class Uniform:
    """A number sampled uniformly from [low, high)."""

    low: float
    """Smallest value, in the unit of what is sampled: metres or radians."""
    high: float
    """End of the range, in the same unit; equal to `low`, every sample is `low`."""

    def __post_init__(self) -> None:
        if not self.low <= self.high:
            raise ValueError(
                f"Uniform needs low <= high, got {self.low} and {self.high}."
            )

    def sample(self, rng: np.random.Generator) -> float:
        """One number, in the unit of the range."""
        return float(rng.uniform(self.low, self.high))


def around(centre: float, half: float) -> Uniform:
    """Uniform over [centre - half, centre + half), in metres or radians."""
    return Uniform(centre - half, centre + half)


ANY_YAW = Uniform(-math.pi, math.pi)
"""Any rotation about the vertical, in radians."""


@dataclass(frozen=True, slots=True)
class Choice:
    """One of several values, each equally likely."""

    options: tuple[str, ...]
    """The values; at least one."""

    def __post_init__(self) -> None:
        if not self.options:
            raise TaskError("A Choice needs at least one option, got none.")

    def sample(self, rng: np.random.Generator) -> str:
        """One of the options."""
        return self.options[int(rng.integers(len(self.options)))]
