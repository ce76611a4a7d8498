"""Policies that answer many episodes at a time, for processes to import; some misbehave."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from duobench.policy import PolicyMetadata, Session, noise
from duobench.world.robot.joints import JOINT_RANGES
from tests.evaluation import toy_tasks
from tests.evaluation.toy_tasks import HORIZON, dies, mark, raises, seed_of

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
        self.before({(one.seed, one.call) for one in sessions})
        drawn = np.stack([noise(one.seed, one.call, (16,)) for one in sessions])
        seen = np.stack([observation["agent_pos"] for observation in observations])
        output = np.tanh(np.hstack([seen, 2 * drawn]) @ self._first) @ self._second
        portion = 1 / (1 + np.exp(-8 * output.reshape(-1, 3, 16)))
        return LOW + portion * (HIGH - LOW)

    def before(self, asked: set[tuple[int, int]]) -> None:
        """What is done before an answer to calls of episodes, by their seeds."""


class DiesOnce(Wanders):
    """Kills its process in the middle of the run, once."""

    def before(self, asked: set[tuple[int, int]]) -> None:
        if any(call == 3 for _, call in asked) and mark("died"):
            dies()


class DiesInOne(Wanders):
    """Kills its process in the first episode of the second task."""

    def before(self, asked: set[tuple[int, int]]) -> None:
        if (seed_of("nod", 0), 2) in asked:
            dies()


class DiesLate(Wanders):
    """Kills its process after the horizon of the second episode."""

    def before(self, asked: set[tuple[int, int]]) -> None:
        if (seed_of("wave", 1), HORIZON // 3) in asked:
            mark("late")
            dies()


class Hangs(Wanders):
    """Does not come back from the first episode."""

    def before(self, asked: set[tuple[int, int]]) -> None:
        if (seed_of("wave", 0), 2) in asked:
            time.sleep(1000)


class Breaks(Wanders):
    """Raises in the first episode, and gives no numbers in the second."""

    def before(self, asked: set[tuple[int, int]]) -> None:
        if (seed_of("wave", 0), 1) in asked:
            raises()

    def act_batch(self, sessions: Sequence[Session], observations: Sequence[dict]) -> np.ndarray:
        chunks = super().act_batch(sessions, observations)
        chunks[[one.seed == seed_of("wave", 1) for one in sessions]] = np.nan
        return chunks


class Searches(Wanders):
    """Looks for a simulator in every step, and stops if it finds one."""

    def before(self, asked: set[tuple[int, int]]) -> None:  # noqa: ARG002
        if found := toy_tasks.simulators():
            raise RuntimeError(f"found {found}")


class Reads(Wanders):
    """Does what the plain policy of this name does."""

    metadata = toy_tasks.Reads.metadata

    def act_batch(  # type: ignore[override] - a list
        self,
        sessions: Sequence[Session],  # noqa: ARG002 - it samples nothing
        observations: Sequence[dict[str, Any]],
    ) -> list[np.ndarray]:
        return [toy_tasks.Reads().act(observation) for observation in observations]
