"""An episode is a function of task and seed, bit for bit: not of the process, of what ran before,
of the vector environment around it, or of the number of workers.
"""

import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench.envs.registration import env_id
from duobench.evaluation.policies import ExpertPolicy
from duobench.evaluation.records import EpisodeRecord
from duobench.tasks import catalog

SEED, OTHER_SEED = 0, 1
REPLAYED = 75
"""Control steps that vector environments replay: until objects are grasped in every task."""

FRESH = """
import sys
from tests.test_determinism import expert_episode, make
print(expert_episode(make(sys.argv[1]), int(sys.argv[2]))[0])
"""


def make(name: str) -> gym.Env:
    return duobench.make(name, cameras=False)


def expert_episode(env: gym.Env, seed: int) -> tuple[str, list[np.ndarray], str]:
    """Fingerprint at the end, the actions, and the fingerprint after `REPLAYED` of them."""
    expert = ExpertPolicy(env)
    observation, info = env.reset(seed=seed)
    expert.reset(info["instruction"], seed)
    actions: list[np.ndarray] = []
    midway, over = "", False
    while not over:
        action = np.asarray(expert.act(observation)[0], dtype=np.float32)
        observation, _, terminated, truncated, _ = env.step(action)
        actions.append(action)
        over = terminated or truncated
        if len(actions) == REPLAYED:
            midway = env.get_wrapper_attr("fingerprint")()
    return env.get_wrapper_attr("fingerprint")(), actions, midway


@pytest.mark.parametrize("name", catalog.names())
def test_an_episode_is_the_same_in_any_process_and_after_any_other(name: str) -> None:
    root = Path(__file__).parents[1]
    fresh = subprocess.Popen(
        [sys.executable, "-c", FRESH, name, str(SEED)], cwd=root, stdout=subprocess.PIPE, text=True
    )
    env = make(name)
    other, _, _ = expert_episode(env, OTHER_SEED)
    here, actions, midway = expert_episode(env, SEED)
    env.close()
    elsewhere = fresh.communicate()[0].strip()
    assert fresh.returncode == 0
    assert here == elsewhere
    assert here != other

    for vector in (gym.vector.SyncVectorEnv, gym.vector.AsyncVectorEnv):
        envs = vector([lambda: gym.make(env_id(name), cameras=False)] * 2)
        envs.reset(seed=[SEED, OTHER_SEED])
        for action in actions[:REPLAYED]:
            envs.step(np.stack([action, action]))
        prints = envs.call("fingerprint")
        envs.close()
        assert prints[0] == midway
        assert prints[1] != midway


def test_workers_change_nothing(tmp_path: Path) -> None:
    tasks = ["bin_sort", "join_blocks"]
    for workers in ("1", "2"):
        command = [
            sys.executable,
            "-m",
            "duobench",
            "eval",
            "--policy",
            "expert",
            "--episodes",
            "2",
        ]
        command += ["--tasks", *tasks, "--workers", workers, "--out", str(tmp_path / workers)]
        subprocess.run(command, check=True, capture_output=True)
    one, two = (_records(tmp_path / workers) for workers in ("1", "2"))
    assert len(one) == len(two) == 2 * len(tasks)
    assert one == two


def _records(folder: Path) -> dict[tuple[str, int], str]:
    from duobench.evaluation.records import read_record

    records: list[EpisodeRecord] = [
        read_record(path) for path in (folder / "records").rglob("*.json")
    ]
    return {(record.task, record.episode): record.fingerprint for record in records}
