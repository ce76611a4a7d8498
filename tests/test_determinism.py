"""An episode is a function of task and seed, bit for bit: not of the process, of what ran before,
of cameras, of the vector environment around it, or of the number of workers.

This is the place where that is proven; other tests rely on it.
"""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench.envs.registration import env_id
from duobench.evaluation.policies import ExpertPolicy
from duobench.evaluation.records import EpisodeRecord
from duobench.randomness import episode_seed
from duobench.sim.duo import HOME
from duobench.tasks import catalog
from tests.experts.baseline_episodes import Episode, make, play, play_alone

SEED, OTHER_SEED = 0, 1
VECTOR_TASKS = ("bin_sort", "ball_maze")
"""The shortest task, and one whose layouts have a variant."""

FRESH = """
import sys
from tests.experts.baseline_episodes import play_alone
print(play_alone(sys.argv[1], int(sys.argv[2])).state_hash)
"""
ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module", params=catalog.names())
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def elsewhere(name: str) -> Iterator[subprocess.Popen[str]]:
    """A new process that plays one episode, its first, and prints the state hash."""
    command = [sys.executable, "-c", FRESH, name, str(SEED)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        yield process


@pytest.fixture(scope="module")
def episodes(name: str) -> tuple[Episode, Episode]:
    """Episodes of both seeds, the other one first, by one expert in one environment."""
    env = make(name)
    expert = ExpertPolicy(env)
    other, here = play(env, expert, OTHER_SEED), play(env, expert, SEED)
    env.close()
    return here, other


def test_an_episode_is_the_same_in_any_process_and_after_any_other(
    elsewhere: subprocess.Popen[str], episodes: tuple[Episode, Episode]
) -> None:
    here, other = episodes
    printed, _ = elsewhere.communicate()
    assert elsewhere.returncode == 0
    assert printed.strip() == here.state_hash
    assert here.state_hash != other.state_hash


@pytest.mark.parametrize("name", ["bin_sort"], indirect=True)
def test_cameras_change_nothing(name: str, episodes: tuple[Episode, Episode]) -> None:
    env = duobench.make(name, cameras=("head",), image_size=(24, 32))
    env.reset(seed=SEED)
    for action in episodes[0].actions:
        env.step(action)
    assert env.get_wrapper_attr("state_hash")() == episodes[0].state_hash
    env.close()


@pytest.mark.parametrize("name", VECTOR_TASKS, indirect=True)
@pytest.mark.parametrize("vector", [gym.vector.SyncVectorEnv, gym.vector.AsyncVectorEnv])
def test_vector_environments_play_the_same_episodes(
    name: str, episodes: tuple[Episode, Episode], vector: type[gym.vector.VectorEnv]
) -> None:
    """Each environment gets its own episode's actions; who is done first goes on with another."""
    envs = vector([lambda: gym.make(env_id(name), cameras=False)] * len(episodes))
    envs.reset(seed=[SEED, OTHER_SEED])
    last = [len(episode.actions) - 1 for episode in episodes]
    ends: dict[int, str] = {}
    for step in range(max(last) + 1):
        actions = [e.actions[step] if step < len(e.actions) else HOME.flat for e in episodes]
        _, _, terminated, truncated, _ = envs.step(np.array(actions, dtype=np.float32))
        for number, over in enumerate(terminated | truncated):
            if step <= last[number]:
                assert over == (step == last[number])
            if step == last[number]:
                # The environment resets itself at the next step.
                ends[number] = envs.call("state_hash")[number]
    envs.close()
    assert ends == {number: episode.state_hash for number, episode in enumerate(episodes)}


def test_workers_change_nothing(tmp_path: Path) -> None:
    """Compared byte for byte: records hold no time, but layout, steps, stages and state_hash."""
    tasks, episodes = ["bin_sort", "carry_pot"], 3
    for workers in ("0", "2"):
        command = [sys.executable, "-m", "duobench", "eval", "--policy", "expert"]
        command += ["--episodes", str(episodes), "--videos", "0", "--tasks", *tasks]
        command += ["--workers", workers, "--out", str(tmp_path / workers)]
        subprocess.run(command, check=True, capture_output=True)
    here, pool = (_records(tmp_path / workers) for workers in ("0", "2"))
    assert len(here) == episodes * len(tasks)
    assert here == pool
    records = [EpisodeRecord.from_json(text) for text in here.values()]
    assert len({record.state_hash for record in records} - {None}) == len(records)
    assert {record.task for record in records if record.success} == set(tasks)
    seed = episode_seed(tasks[0], episodes - 1)
    assert play_alone(tasks[0], seed).state_hash in {record.state_hash for record in records}


def _records(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): path.read_text(encoding="utf-8")
        for path in (folder / "records").rglob("*.json")
    }
