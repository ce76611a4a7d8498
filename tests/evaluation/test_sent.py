"""What a record keeps of an episode plays it again, without its policy."""

import base64
import json
from dataclasses import asdict, replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from duobench.envs.registration import make
from duobench.evaluation.policies import PolicyChoice
from duobench.policy import PolicyMetadata, RandomPolicy
from duobench.results.records import EpisodeRecord, StateHashes
from duobench.results.suite import TaskInfo
from duobench.types import Array
from tests.results.samples import key


class Drifts(RandomPolicy):
    """Moves both tool centre points at random: its own numbers are not the joint targets."""

    metadata = PolicyMetadata(name="drifts", cameras=(), action_mode="cartesian_relative")

    def act(self, observation: Any) -> Any:
        joints = super().act(observation) - observation["agent_pos"]
        return np.clip(joints[:, :14], -0.01, 0.01).astype(np.float32)


def hashes(env: gym.Env) -> StateHashes:
    state = env.get_wrapper_attr("save_state")()
    return StateHashes(physics=state.physics_hash, stages=state.progress_hash)


def replayed(task: TaskInfo, record: EpisodeRecord, targets: Array) -> tuple[Any, Any, int]:
    """The states at the start and at the end of an episode of these targets, and its stage."""
    config = replace(record.config, action_mode="joint")
    env = make(task.reference, **asdict(config))
    _, info = env.reset(seed=record.seed)
    start = hashes(env)
    for command in targets:
        _, _, _, _, info = env.step(command)
    end = hashes(env)
    env.close()
    return start, end, info["stage"]


@pytest.mark.parametrize("policy", ["hold", "random", f"{__name__}:Drifts"])
def test_targets_play_the_episode_again_to_the_bit(play, policy):
    _, results = play(PolicyChoice.parse(policy), episodes=2)
    for one in results.tasks:
        for record in one.records:
            targets = record.targets()
            assert targets is not None
            assert targets.shape == (record.steps, 16)
            again = replayed(one.task, record, targets)
            assert again == (record.start, record.end, record.final_stage)
            targets[-2] += 1e-3
            assert replayed(one.task, record, targets)[1] != record.end


def test_episode_of_a_broken_policy_keeps_what_was_sent(play):
    _, results = play("Faulty", episodes=2, workers=1)
    record = next(one for one in results.tasks if one.task.id == "wave").records[1]
    assert record.error
    targets = record.targets()
    assert targets is not None
    assert len(targets) == record.steps == 3
    assert record.start
    assert record.end is None


def test_targets_stand_in_the_file_as_text(play):
    folder, results = play("random", episodes=1)
    record = results.tasks[0].records[0]
    document = json.loads(folder.record(key(folder, record.task, 0)).read_text())
    assert base64.b64decode(document["sent"]) == record.sent
    assert set(document["end"]) == {"physics", "stages"}
