"""Two policies that wait for whoever leads a test, before each of their chunks."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from duobench.policy import PolicyMetadata

CHUNK = 5
TIMEOUT_S = 60
IMAGE_SIZE = (24, 32)
MODULE = "tests.real.sessions.toys"


class Patient:
    """Moves the left wrist a little; acts when it is let."""

    gate: ClassVar[threading.Semaphore] = threading.Semaphore(0)
    waiting: ClassVar[threading.Semaphore] = threading.Semaphore(0)
    name = "patient"
    direction = 1.0

    def __init__(self) -> None:
        self.metadata = PolicyMetadata(
            name=self.name, cameras=("head",), image_size=IMAGE_SIZE, version="1", horizon=CHUNK
        )

    def reset(self, instruction: str, seed: int) -> None:
        assert instruction
        assert seed
        for semaphore in (self.gate, self.waiting):
            while semaphore.acquire(blocking=False):
                pass

    def act(self, observation: Mapping[str, Any]) -> NDArray[np.float64]:
        assert observation["pixels"]["head"].shape == (*IMAGE_SIZE, 3)
        self.waiting.release()
        assert self.gate.acquire(timeout=TIMEOUT_S)
        chunk = np.tile(observation["agent_pos"].astype(np.float64), (CHUNK, 1))
        chunk[:, 6] += self.direction * 0.005 * np.arange(1, CHUNK + 1)
        return chunk


class Keen(Patient):
    name = "keen"
    direction = -1.0


class Broken(Patient):
    """Raises in its second chunk."""

    name = "broken"

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        self.chunks = 0

    def act(self, observation: Mapping[str, Any]) -> NDArray[np.float64]:
        chunk = super().act(observation)
        self.chunks += 1
        if self.chunks > 1:
            raise RuntimeError("out of ideas")
        return chunk


class Unready(Patient):
    """Raises before its first episode."""

    name = "unready"

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - as policies have it
        raise RuntimeError("no model")
