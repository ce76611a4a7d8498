"""Policies that answer many episodes at a time, for processes to import; some misbehave."""

import os
import signal
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from duobench.policy import HoldPolicy, PolicyMetadata, Session, noise
from duobench.robot.joints import JOINT_RANGES
from tests.evaluation import toy_tasks
from tests.evaluation.toy_tasks import mark, seed_of

WIDTH = 64
LOW, HIGH = np.vstack([np.vstack([JOINT_RANGES, (0.0, 1.0)])] * 2).T.astype(np.float32)


class Wanders:
    """Moves with noise, through a network whose last bits depend on the size of the batch."""

    metadata = PolicyMetadata(name="wanders", cameras=(), horizon=3, dtype="float32", device="cpu")

    def __init__(self) -> None:
        generator = np.random.default_rng(0)
        self._first = generator.standard_normal((32, WIDTH), dtype=np.float32)
        self._second = generator.standard_normal((WIDTH, 48), dtype=np.float32) / WIDTH

    def begin(self, instruction: str, seed: int) -> Session:
        return Session(instruction=instruction, seed=seed)

    def act_batch(
        self, sessions: Sequence[Session], observations: Sequence[dict[str, Any]]
    ) -> np.ndarray:
        drawn = np.stack([noise(one.seed, one.call, (16,)) for one in sessions])
        seen = np.stack([observation["agent_pos"] for observation in observations])
        output = np.tanh(np.hstack([seen, 2 * drawn]) @ self._first) @ self._second
        portion = 1 / (1 + np.exp(-8 * output.reshape(-1, 3, 16)))
        return LOW + portion * (HIGH - LOW)


class DiesOnce(Wanders):
    """Kills its process in the middle of the run, once."""

    def act_batch(self, sessions: Sequence[Session], observations: Sequence[dict]) -> np.ndarray:
        if any(one.call == 3 for one in sessions) and mark("died"):
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act_batch(sessions, observations)


class DiesInOne(Wanders):
    """Kills its process in the first episode of the second task."""

    def act_batch(self, sessions: Sequence[Session], observations: Sequence[dict]) -> np.ndarray:
        if any((one.seed, one.call) == (seed_of("nod", 0), 2) for one in sessions):
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act_batch(sessions, observations)


class DiesLate(Wanders):
    """Kills its process after the horizon of the second episode."""

    def act_batch(self, sessions: Sequence[Session], observations: Sequence[dict]) -> np.ndarray:
        calls = toy_tasks.HORIZON // 3
        if any((one.seed, one.call) == (seed_of("wave", 1), calls) for one in sessions):
            mark("late")
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act_batch(sessions, observations)


class Hangs(Wanders):
    """Does not come back from the first episode."""

    def act_batch(self, sessions: Sequence[Session], observations: Sequence[dict]) -> np.ndarray:
        if any((one.seed, one.call) == (seed_of("wave", 0), 2) for one in sessions):
            time.sleep(1000)
        return super().act_batch(sessions, observations)


class Breaks(Wanders):
    """Raises in the first episode, and gives no numbers in the second."""

    def act_batch(self, sessions: Sequence[Session], observations: Sequence[dict]) -> np.ndarray:
        chunks = super().act_batch(sessions, observations)
        for row, session in enumerate(sessions):
            if session.seed == seed_of("wave", 0) and session.call == 1:
                raise ZeroDivisionError("my policy is broken")
            if session.seed == seed_of("wave", 1):
                chunks[row] = np.nan
        return chunks


class Reads(Wanders):
    """Does what the plain policy of this name does."""

    metadata = toy_tasks.Reads.metadata

    def act_batch(  # type: ignore[override] - a list
        self,
        sessions: Sequence[Session],  # noqa: ARG002 - it samples nothing
        observations: Sequence[dict[str, Any]],
    ) -> list[np.ndarray]:
        return [toy_tasks.Reads().act(observation) for observation in observations]


class Searches(Wanders):
    """Looks for a simulator in every step, and stops if it finds one."""

    def act_batch(self, sessions: Sequence[Session], observations: Sequence[dict]) -> np.ndarray:
        if found := toy_tasks.simulators():
            raise RuntimeError(f"found {found}")
        return super().act_batch(sessions, observations)


class Unseeded(HoldPolicy):
    """Says that its noise cannot be controlled."""

    metadata = PolicyMetadata(name="unseeded", cameras=(), seeded=False)
