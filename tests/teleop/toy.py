"""A policy whose answers tests decide, for sessions in which a policy plays."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from duobench.data import Actor, ActorKind
from duobench.policy import PolicyMetadata

POLICY = Actor(kind=ActorKind.POLICY, name="toy")


class Toy:
    """Answers what it is let answer, by default to stay, and remembers what it was shown."""

    def __init__(self, mode: str = "joint", **seen: Any) -> None:
        self.metadata = PolicyMetadata(name="toy", action_mode=mode, **{"cameras": (), **seen})
        self.gate: threading.Semaphore | None = None
        self.shown: list[Any] = []
        self.fails: Exception | None = None
        self.fails_to_begin = False
        self.begun = 0
        self.hold: Any = None

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002
        self.shown.clear()
        self.begun += 1
        if self.fails_to_begin:
            raise ValueError("not yet")

    def act(self, observation: Any) -> Any:
        self.shown.append(observation)
        if self.gate is not None:
            self.gate.acquire()
        if self.fails is not None:
            raise self.fails
        return np.tile(self.hold(), (4, 1))


class Still:
    """Stays where its arms are, about."""

    def __init__(self) -> None:
        self.metadata = PolicyMetadata(name="still", action_mode="joint", cameras=())

    def reset(self, instruction: str, seed: int) -> None:
        """Begin."""

    def act(self, observation: Any) -> Any:
        return observation["agent_pos"][None]
