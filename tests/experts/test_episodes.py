"""Episodes of every expert, each played once and asked everything that tests want to know of it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from duobench.tasks import catalog
from tests.envs.tools import equal
from tests.experts.baseline_episodes import Episode, make, play_alone
from tests.golden import episodes as golden

SEED, OTHER_SEED = golden.SEEDS
SAVES = 3
"""Random control steps of an episode at which its state is restored."""
ROOT = Path(__file__).parents[2]
BACKWARDS = """
from duobench.tasks import catalog
from tests.experts.baseline_episodes import play_alone
for name in reversed(catalog.names()):
    print(name, play_alone(name, 0)[0].state_hash, flush=True)
"""

TASKS = pytest.mark.parametrize("name", catalog.names())


@pytest.fixture(scope="module", autouse=True)
def elsewhere() -> Iterator[subprocess.Popen[str]]:
    """A process that plays the same, while this one does, but begins with the last task."""
    command = [sys.executable, "-c", BACKWARDS]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        yield process


@pytest.fixture(scope="module")
def hashes_elsewhere(elsewhere: subprocess.Popen[str]) -> dict[str, str]:
    printed, _ = elsewhere.communicate()
    assert elsewhere.returncode == 0
    return dict(line.split() for line in printed.splitlines())


@cache
def played(name: str) -> tuple[Episode, Episode]:
    """Episodes of both seeds, the other one first, by one expert in one environment."""
    other, here = play_alone(name, OTHER_SEED, SEED)
    return here, other


@TASKS
def test_an_episode_is_the_golden_one(name: str) -> None:
    expected = golden.read()["tasks"][name]
    for seed, episode in zip(golden.SEEDS, played(name), strict=True):
        found = golden.summary(episode)
        assert list(golden.episode_differences(f"seed {seed}", expected[str(seed)], found)) == []
        assert found["stages"][-1][1] == catalog.get(name).max_stage
        assert episode.results[-1][-1]["success"]


@TASKS
def test_a_saved_state_goes_on_as_it_did(name: str) -> None:
    _, episode = played(name)
    hashes = [state.hash for state in episode.states]
    assert len(set(hashes)) == len(hashes)
    env = make(name)
    rng = np.random.default_rng(0)
    for start in sorted(rng.integers(len(episode.actions), size=SAVES), reverse=True):
        env.reset(seed=2)
        observation, info = env.get_wrapper_attr("restore_state")(episode.states[start])
        assert env.get_wrapper_attr("state_hash")() == hashes[start]
        before, *_, told = episode.results[start]
        assert equal(observation, before)
        for key in ("stage", "success", "instruction", "current_subinstruction", "sent"):
            assert equal(info[key], told[key]), key
        for number in range(start, len(episode.actions)):
            assert equal(env.step(episode.actions[number]), episode.results[number + 1])
        assert env.get_wrapper_attr("state_hash")() == hashes[-1]
    env.close()


@TASKS
def test_an_episode_is_the_same_in_any_process_and_after_any_other(
    name: str, hashes_elsewhere: dict[str, str]
) -> None:
    here, other = played(name)
    assert hashes_elsewhere[name] == here.state_hash
    assert here.state_hash != other.state_hash
