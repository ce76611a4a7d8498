"""What a served policy costs: the socket for one call, and how batches speed several workers up."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from dev.benchmarks.measure import Measurement, Work, seconds
from duobench.core.types import POLICY_CAMERAS
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.runners.evaluate import evaluate
from duobench.policy import Batching, PolicyMetadata, Session, SessionPolicy
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.client import OpenpiPolicy
from duobench.policy.serving.host import PolicyHost
from duobench.results.folder import RunFolder
from duobench.results.suite import Suite, find_tasks

MILLI = 1e-3
FIRST_S, EACH_S = 0.25, 0.02
"""What stands for a large model on a graphics card: a call, and each observation in it."""
LOG = "DUOBENCH_BENCHMARK_LOG"
"""Environment variable: file in which the policy's process notes its calls."""
CHUNK = 30
WORKERS = 4
TASK = "transfer_cube"


class Still:
    """Keeps the arms where they are, at once."""

    metadata = PolicyMetadata(
        name="still", cameras=POLICY_CAMERAS, image_size=(224, 224), horizon=CHUNK
    )

    def begin(self, instruction: str, seed: int) -> Session:
        """Begin an episode."""
        return Session(instruction=instruction, seed=seed)

    def act_batch(
        self,
        sessions: Sequence[Session],  # noqa: ARG002 - remembers nothing
        observations: Sequence[dict[str, Any]],
    ) -> np.ndarray:
        """Chunks (B, 30, 16) of where the arms are."""
        state = np.stack([observation["agent_pos"] for observation in observations])
        return np.repeat(state[:, None], CHUNK, axis=1)


class Costly(Still):
    """As still, but takes as long as a large model."""

    def act_batch(
        self, sessions: Sequence[Session], observations: Sequence[dict[str, Any]]
    ) -> np.ndarray:
        """Chunks (B, 30, 16), after a while."""
        time.sleep(FIRST_S + EACH_S * len(observations))
        with Path(os.environ[LOG]).open("a", encoding="ascii") as log:
            print(time.monotonic(), *(session.seed for session in sessions), file=log)
        return super().act_batch(sessions, observations)


def measure() -> Iterator[Measurement]:
    """Measure the socket, then whole evaluations with one worker and with several."""
    yield _socket()
    calls = {workers: _calls_per_second(workers) for workers in (1, WORKERS)}
    for workers, rate in calls.items():
        what = f"served in dynamic batches, {workers} worker{'s' * (workers > 1)}"
        yield Measurement(what=what, value=rate, unit="calls/s")
    what = f"{WORKERS} workers against one"
    yield Measurement(what=what, value=calls[WORKERS] / calls[1], at_least=2.2)


def _socket() -> Measurement:
    """What the server adds to a call with three images."""
    batching = Batching(mode="dynamic", size=1)
    local = SessionPolicy(Still(), batching)
    host = PolicyHost(Still(), Still.metadata, batching)
    thread = threading.Thread(target=host.run, daemon=True)
    thread.start()
    remote = OpenpiPolicy(RemoteServer(url=f"ws://127.0.0.1:{host.port}"))
    drawn = np.random.default_rng(0)
    images = {name: drawn.integers(0, 255, (224, 224, 3), np.uint8) for name in POLICY_CAMERAS}
    seen = {"agent_pos": np.zeros(16, np.float32), "pixels": images}
    for policy in (local, remote):
        policy.reset("Do nothing.", 0)
    works = [Work(pieces=[lambda policy=policy: policy.act(seen)]) for policy in (local, remote)]
    here, there = seconds(*works, repeats=200)
    remote.close()
    host.stop()
    thread.join()
    what = "socket, for a call with three images of 224x224"
    return Measurement(what=what, value=(there - here) / MILLI, unit="ms", at_most=3.0)


def _calls_per_second(workers: int) -> float:
    """Calls a second of an evaluation, while all of its workers play."""
    choice = PolicyChoice.parse(f"{__name__}:{Costly.__name__}", batching=Batching(mode="dynamic"))
    suite = Suite(tasks=find_tasks([TASK]), episodes=2 * workers + 1)
    with TemporaryDirectory() as folder:
        log = Path(folder) / "calls"
        os.environ[LOG] = str(log)
        evaluate(choice, suite, RunFolder(Path(folder) / "run"), workers=workers)
        lines = [line.split() for line in log.read_text().splitlines()]
    batches = [(float(when), seeds) for when, *seeds in lines]
    # All play from when each has an episode until the last episode has begun.
    seen: set[str] = set()
    begun: list[float] = []
    for when, seeds in batches:
        begun += [when] * len(set(seeds) - seen)
        seen |= set(seeds)
    start, stop = begun[workers - 1], begun[-1]
    return sum(len(seeds) for when, seeds in batches if start < when <= stop) / (stop - start)
