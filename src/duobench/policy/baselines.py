"""Policies that know nothing: the floor that every score stands on."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from duobench.core.types import FLAT_SIZE, OPENING_SLOTS, Array
from duobench.policy.policy import PolicyMetadata
from duobench.world.robot.joints import JOINT_RANGES

_OPEN = 1.0
_RANDOM_STREAM = 0x706F6C
"""Separates a policy's samples from all others with the same seed."""


class ZeroPolicy:
    """Sends 16 zeros: every joint target 0, clipped into its range, both grippers closed."""

    metadata = PolicyMetadata(name="zero", cameras=())

    def reset(self, instruction: str, seed: int) -> None:
        """There is nothing to forget."""

    def act(self, observation: Mapping[str, Any]) -> Array:  # noqa: ARG002 - sees nothing
        """One action (1, 16) of zeros."""
        return np.zeros((1, FLAT_SIZE))


class RandomPolicy:
    """Samples every action uniformly from the joint action space."""

    metadata = PolicyMetadata(name="random", cameras=())

    def __init__(self) -> None:
        sides = [np.vstack([JOINT_RANGES, (0.0, _OPEN)])] * 2
        self._low, self._high = np.vstack(sides).T
        self._generator = np.random.default_rng(_RANDOM_STREAM)

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - follows no instruction
        """Start the generator of this seed."""
        self._generator = np.random.default_rng((_RANDOM_STREAM, seed))

    def act(self, observation: Mapping[str, Any]) -> Array:  # noqa: ARG002 - sees nothing
        """One action (1, 16) within the joint ranges and openings 0..1."""
        return self._generator.uniform(self._low, self._high)[None]


class HoldPolicy:
    """Keeps the joint positions that it saw first, with both grippers open."""

    metadata = PolicyMetadata(name="hold", cameras=())

    def __init__(self) -> None:
        self._action: Array | None = None

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - always does the same
        """Forget the posture of the last episode."""
        self._action = None

    def act(self, observation: Mapping[str, Any]) -> Array:
        """One action (1, 16): the first joint positions of this episode, openings 1."""
        if self._action is None:
            self._action = np.array(observation["agent_pos"], dtype=np.float64)[None]
            self._action[:, OPENING_SLOTS] = _OPEN
        return self._action
