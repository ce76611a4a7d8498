"""Small recordings for tests: a short episode of one task, in whatever way it is to end."""

import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import duobench
from duobench.data import Actor, DataSet, Outcome, Recorder, Recording
from tests.envs.tools import wave

TASK = "bin_sort"
HORIZON = 40
ROOT = Path(__file__).parents[2]
SOURCES = os.pathsep.join([str(ROOT / "src"), str(ROOT)])


def recorder(folder: Path, **options: Any) -> Recorder:
    """An environment of forty steps without images, which records."""
    options = {"cameras": False, "horizon": HORIZON} | options
    return Recorder(duobench.make(TASK, **options), folder, Actor(name="wave"))


def data_of(folder: Path, episodes: int, **options: Any) -> DataSet:
    """A data set of whole episodes, of the seeds from 0 on."""
    env = recorder(folder, **options)
    for seed in range(episodes):
        play(env, seed=seed)
    env.close()
    return DataSet.open(folder)


def child_of(*command: object) -> subprocess.Popen[str]:
    """A module of these tests as a program of its own, which finds the package and the tests."""
    return subprocess.Popen(
        [sys.executable, "-m", *map(str, command)],
        env={**os.environ, "PYTHONPATH": SOURCES},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def play(env: Recorder, steps: int = HORIZON, seed: int = 0) -> list[dict[str, Any]]:
    """Wave for some steps; what every step gave."""
    env.reset(seed=seed)
    seen = []
    for number in range(steps):
        action = wave(number)
        observation, reward, *_, info = env.step(action)
        seen.append({"action": action, "reward": reward, **observation, **info})
    return seen


def recorded(folder: Path, steps: int = HORIZON, **options: Any) -> Recording:
    """One recorded episode."""
    env = recorder(folder, **options)
    play(env, steps)
    env.close()
    return only(folder)


def only(folder: Path) -> Recording:
    """The one episode of a data set."""
    (path,) = DataSet.open(folder).episodes()
    return Recording.read(path)


def ended(recording: Recording) -> Outcome:
    """How an episode ended."""
    assert recording.info.outcome is not None
    return recording.info.outcome


def equal(one: Recording, other: Recording) -> bool:
    """Whether two recordings hold the same rows and say the same."""
    names = [name for name in Recording.__slots__ if name != "info"]
    arrays = all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)
    return arrays and one.info == other.info


@contextmanager
def room(size: int) -> Iterator[None]:
    """A disk that is full: no file grows beyond a number of bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
