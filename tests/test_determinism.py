"""An episode is a function of task and seed, bit for bit: not of cameras, of the vector environment
around it, or of the number of workers.

`tests.experts.test_episodes` adds the process and what ran before. These are the places where that
is proven; other tests rely on it.
"""

import subprocess
import sys
from functools import cache
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench.envs.ids import env_id
from duobench.files import decode
from duobench.randomness import episode_seed
from duobench.results.records import RECORD_SCHEMA, EpisodeRecord
from duobench.sim.duo import HOME
from tests.experts.baseline_episodes import Episode, play_alone

SEED, OTHER_SEED = 0, 1
VECTOR_TASKS = ("bin_sort", "ball_maze")
"""The shortest task, and one whose layouts have a variant."""

ROOT = Path(__file__).parents[1]


@cache
def played(name: str) -> tuple[Episode, ...]:
    return play_alone(name, SEED, OTHER_SEED)


def test_cameras_change_nothing() -> None:
    name = VECTOR_TASKS[0]
    (episode, _) = played(name)
    env = duobench.make(name, cameras=("head",), image_size=(24, 32))
    env.reset(seed=SEED)
    for action in episode.actions:
        env.step(action)
    assert env.get_wrapper_attr("state_hash")() == episode.state_hash
    env.close()


@pytest.mark.parametrize("name", VECTOR_TASKS)
@pytest.mark.parametrize("vector", [gym.vector.SyncVectorEnv, gym.vector.AsyncVectorEnv])
def test_vector_environments_play_the_same_episodes(
    name: str, vector: type[gym.vector.VectorEnv]
) -> None:
    """Each environment gets its own episode's actions; who is done first goes on with another."""
    episodes = played(name)
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
    tasks, episodes = ["bin_sort", "carry_pot"], 2
    for workers in ("0", "2"):
        command = [sys.executable, "-m", "duobench", "eval", "--policy", "expert"]
        command += ["--episodes", str(episodes), "--videos", "0", "--tasks", *tasks]
        command += ["--workers", workers, "--out", str(tmp_path / workers)]
        subprocess.run(command, check=True, capture_output=True)
    here, pool = (_records(tmp_path / workers) for workers in ("0", "2"))
    assert len(here) == episodes * len(tasks)
    assert here == pool
    records = [decode(text, EpisodeRecord, RECORD_SCHEMA) for text in here.values()]
    assert len({record.state_hash for record in records} - {None}) == len(records)
    assert {record.task for record in records if record.success} == set(tasks)
    seed = episode_seed(tasks[0], episodes - 1)
    assert play_alone(tasks[0], seed)[0].state_hash in {record.state_hash for record in records}


def _records(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): path.read_text(encoding="utf-8")
        for path in (folder / "records").rglob("*.json")
    }
