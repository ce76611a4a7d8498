"""Kill an evaluation at random moments, again and again: what comes out must be what comes out.

    python -m dev.benchmarks.kills --kills 100 --seed 0

Killed are the process that writes, the workers, the processes of policies, and a server. A run
whose parent was killed is started again. In the end all files that results are in must have the
bytes of a run that nobody disturbed, but for the attempts, which must be those of the journal; the
exit status says whether they do. No policy is killed twice in one episode: that fails it.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from duobench.policy import PolicyMetadata, Session, noise
from duobench.results.attempts import ERROR, FAILURE, POLICY, SUCCESS
from duobench.results.folder import RunFolder
from duobench.results.report import write_report

ROOT = Path(__file__).parents[2]
TASKS, EPISODES, WORKERS = ("carry_pot", "bin_sort"), 3, 2
LONGEST_PAUSE_S = 3.0
"""Seconds from one kill to the next, at most."""
TIMEOUT_S = 300.0
"""Seconds that a run may take without being killed."""
MAX_FAILURES = 20
"""How often it may end with an error, as it does where kills have hit one episode three times."""
RESULTS = ("run.json", "summary.json", "index.html", "records/*/*/*.json")
"""Files that must be the same."""
FINISHED = (SUCCESS, FAILURE, ERROR)
TIMES = re.compile(rb'<section id="times">.*?</section>', re.DOTALL)
"""What of the report may differ."""
POLICIES = ("random", "dev.benchmarks.kills:Wanders", "openpi")


class Wanders:
    """A policy for many episodes, which moves a little at random."""

    metadata = PolicyMetadata(name="wanders", cameras=(), horizon=30)

    def begin(self, instruction: str, seed: int) -> Session:
        """Begin an episode."""
        return Session(instruction=instruction, seed=seed)

    def act_batch(self, sessions: Sequence[Session], observations: Sequence[Any]) -> np.ndarray:
        """A chunk (30, 16) for each."""
        moves = np.stack([noise(one.seed, one.call, (30, 16)) for one in sessions])
        now = np.stack([observation["agent_pos"] for observation in observations])
        return now[:, None] + 0.01 * moves.cumsum(axis=1)


class Killed:
    """One evaluation that is disturbed."""

    def __init__(self, policy: str, folder: Path, port: int) -> None:
        """Choose what is played, and where."""
        self._policy, self._folder, self._port = policy, folder, port
        self._server: subprocess.Popen[bytes] | None = None

    def play(self, generator: random.Random, kills: int, counts: Counter[str]) -> int:
        """Run until all is played, and kill meanwhile, at most so often; how often it was."""
        done = failures = 0
        with self._serving():
            process = self._start()
            while (status := process.poll()) != 0:
                if status is not None:
                    failures += status > 0
                    if failures > MAX_FAILURES:
                        raise AssertionError(f"{self._folder}: it ends with exit code {status}.")
                    process = self._start()
                if done == kills:
                    process.wait(TIMEOUT_S)
                    continue
                deadline = time.monotonic() + TIMEOUT_S
                while process.poll() is None and "worker" not in self._targets(process):
                    if time.monotonic() > deadline:
                        raise AssertionError(f"{self._folder}: no worker within {TIMEOUT_S:g} s.")
                    time.sleep(0.05)
                time.sleep(generator.uniform(0.0, LONGEST_PAUSE_S))
                if process.poll() is not None:
                    continue
                targets = self._targets(process)
                kind = generator.choice(sorted(targets))
                with suppress(ProcessLookupError):
                    os.kill(generator.choice(targets[kind]), signal.SIGKILL)
                    counts[kind] += 1
                    done += 1
                if kind == "parent":
                    process.wait()
                if kind == "server":
                    self._serve()
        return done

    def _targets(self, process: subprocess.Popen[bytes]) -> dict[str, list[int]]:
        found: dict[str, list[int]] = {"parent": [process.pid]}
        if self._server is not None:
            found["server"] = [self._server.pid]
        for entry in Path("/proc").glob("[0-9]*"):
            with suppress(OSError, IndexError):
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
                words = (entry / "cmdline").read_bytes()
                if parent == process.pid:
                    kind = "policy" if b"policy_process" in words else "worker"
                    found.setdefault(kind, []).append(int(entry.name))
        if has_ended(self._folder):
            found.pop("policy", None)
        return found

    def _start(self) -> subprocess.Popen[bytes]:
        served = ("--server", f"ws://127.0.0.1:{self._port}") if self._policy == "openpi" else ()
        return _duobench(
            "eval",
            "--policy",
            self._policy,
            *served,
            "--tasks",
            *TASKS,
            "--videos",
            "0",
            "--episodes",
            str(EPISODES),
            "--workers",
            str(WORKERS),
            "--out",
            str(self._folder),
        )

    @contextmanager
    def _serving(self) -> Iterator[None]:
        if self._policy == "openpi":
            self._serve()
        try:
            yield
        finally:
            if self._server is not None:
                self._server.kill()
                self._server.wait()

    def _serve(self) -> None:
        """Start the server, again once the killed one is gone."""
        if self._server is not None:
            self._server.wait()
        self._server = _duobench("serve", "--policy", POLICIES[1], "--port", str(self._port))


def _duobench(*words: str) -> subprocess.Popen[bytes]:
    folders = os.pathsep.join([str(ROOT / "src"), str(ROOT)])
    return subprocess.Popen(
        [sys.executable, "-m", "duobench", *words],
        env={**os.environ, "PYTHONPATH": folders},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def has_ended(folder: Path) -> bool:
    """Whether a policy has ended in an episode of a run that has no record yet."""
    unfinished = (e for e in RunFolder(folder).attempts().values() if e[-1] not in FINISHED)
    return any(POLICY in ends for ends in unfinished)


def contents(folder: Path) -> dict[str, bytes]:
    """The files of a run that results are in, had every episode been begun once."""
    with tempfile.TemporaryDirectory() as name:
        folder = begun_once(RunFolder(folder), Path(name, "run")).path
        paths = (path for pattern in RESULTS for path in folder.glob(pattern))
        return {str(path.relative_to(folder)): TIMES.sub(b"", path.read_bytes()) for path in paths}


def begun_once(folder: RunFolder, out: Path) -> RunFolder:
    """Copy a run as it were if its attempts were all first ones, after checking that they are told.

    Raises:
        AssertionError: A record does not say what the journal says.
    """
    shutil.copytree(folder.path, out)
    copy, attempts = RunFolder(out), folder.attempts()
    records = folder.read_records(folder.read_run())
    for record in records:
        if (record.attempt, *record.earlier) != (
            len(ends := attempts[record.key.path]),
            *ends[:-1],
        ):
            raise AssertionError(f"{folder.path}: {record.key} does not say that it was {ends}.")
        copy.write(replace(record, attempt=1, earlier=()))
    if any(record.earlier for record in records):
        write_report(copy)
    return copy


def disturb(folder: Path, kills: int, seed: int, port: int) -> Iterator[tuple[str, Counter[str]]]:
    """Kill that often.

    Args:
        folder: An empty folder.
        kills: How often.
        seed: Seed of the moments and of whom it hits.
        port: A free port.

    Yields:
        The policy of a run that was disturbed, and who was killed in it.

    Raises:
        AssertionError: Its results are others.
    """
    generator, expected, left, number = random.Random(seed), {}, kills, 0
    for policy in POLICIES:
        Killed(policy, folder / policy, port).play(generator, 0, Counter())
        expected[policy] = contents(folder / policy)
    while left:
        policy, counts = POLICIES[number % len(POLICIES)], Counter[str]()
        out = folder / f"{number}"
        left -= Killed(policy, out, port).play(generator, min(left, 8), counts)
        if contents(out) != expected[policy]:
            raise AssertionError(f"{out}: results differ after {dict(counts)}")
        yield policy, counts
        number += 1


def report(disturbed: Iterable[tuple[str, Counter[str]]]) -> None:
    """Print what was killed in each run, and in all of them."""
    total = Counter[str]()
    for policy, counts in disturbed:
        total += counts
        print(f"{policy}: the same after {dict(counts)}", flush=True)
    print(f"All the same after {total.total()} kills: {dict(total)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--port", type=int, default=8765)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        report(disturb(Path(name), asked.kills, asked.seed, asked.port))
