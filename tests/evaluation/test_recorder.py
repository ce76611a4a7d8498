"""A record says what happened, and what it keeps of an episode plays it again."""

import base64
import json
from dataclasses import asdict, replace

import numpy as np
import pytest

import duobench
from duobench.core.errors import PolicyTimeoutError
from duobench.core.files import decode, encode
from duobench.core.randomness import episode_seed, policy_seed
from duobench.core.versions import package_versions, record_versions
from duobench.envs.config import EnvConfig
from duobench.envs.registration import make as make_env
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.evaluation.rollout import rollout
from duobench.policy import PolicyMetadata, RandomPolicy, make
from duobench.results.records import RECORD_SCHEMA, EpisodeRecord, StateHashes
from duobench.results.run import Candidate, Run, TimeLimits
from duobench.results.suite import Episode, Suite, find_tasks
from tests.evaluation import toy_tasks
from tests.results.samples import key

(WAVE,) = find_tasks([toy_tasks.WAVE_NAME])
CANDIDATE = Candidate(
    policy="random",
    metadata=PolicyMetadata(name="random", version="7"),
    config=EnvConfig(cameras=()),
)
RUN = Run(
    candidates=(CANDIDATE,),
    suite=Suite(tasks=(WAVE,)),
    limits=TimeLimits(),
    versions=package_versions(),
)
VERSIONS = record_versions(None)


def test_record_says_what_the_environment_said():
    env = duobench.make(toy_tasks.WAVE, cameras=False)
    reached, clipped = set(), set()
    for index in range(6):
        episode = Episode(task=WAVE, index=index)
        recorder = EpisodeRecorder(episode)
        infos: list[dict] = []

        class Keeps(EpisodeRecorder):
            def on_step(self, step, infos=infos):
                infos.append(dict(step.info) | {"unmet": env.get_wrapper_attr("unmet")})

        policy = make("hold" if index % 2 else "random")  # which reach other stages
        rollout(env, policy, seed=episode.seed, watchers=[recorder, Keeps(episode)])
        record = recorder.record(RUN, VERSIONS)
        assert decode(encode(record, RECORD_SCHEMA), EpisodeRecord, RECORD_SCHEMA) == record
        stages = [info["stage"] for info in infos]
        assert [record.stage_after(number + 1) for number in range(len(stages))] == stages
        assert record.success == infos[-1]["success"] == record.terminated
        assert record.truncated == (not record.terminated)
        assert bool(record.unmet) == bool(record.missing) == (not record.success)
        said = {
            "steps": len(infos),
            "success_at_end": infos[-1]["success_at_end"],
            "clipped": sum(info["clipped"].any() for info in infos),
            "unmet": infos[-1]["unmet"],
            "state_hash": env.get_wrapper_attr("state_hash")(),
            "seed": episode_seed("wave", index),
            "policy_seed": policy_seed("wave", record.seed),
            "instruction": "Do the wave.",
        }
        assert {name: getattr(record, name) for name in said} == said
        assert set(record.layout["poses"]) == {"cube"}
        reached.add(record.final_stage)
        clipped.add(bool(record.clipped))
    env.close()
    assert len(reached) > 1
    assert clipped == {False, True}


def test_episode_that_never_began_still_has_a_record():
    recorder = EpisodeRecorder(Episode(task=WAVE, index=3))
    record = recorder.record(RUN, VERSIONS).broken(PolicyTimeoutError("too late"), 0)
    assert record.error == "PolicyTimeoutError: too late\n"
    assert record.policy_version == "7"
    assert not record.success
    assert (record.final_stage, record.steps, record.state_hash) == (0, 0, None)
    assert decode(encode(record, RECORD_SCHEMA), EpisodeRecord, RECORD_SCHEMA) == record


# --- what was sent -------------------------------------------------------------------------------


class Drifts(RandomPolicy):
    """Moves both tool centre points at random: its own numbers are not the joint targets."""

    metadata = PolicyMetadata(name="drifts", cameras=(), action_mode="cartesian_relative")

    def act(self, observation):
        joints = super().act(observation) - observation["agent_pos"]
        return np.clip(joints[:, :14], -0.01, 0.01).astype(np.float32)


def replayed(task, record, targets):
    """The states at the start and at the end of an episode of these targets, and its stage."""
    env = make_env(task.reference, **asdict(replace(record.config, action_mode="joint")))
    _, info = env.reset(seed=record.seed)
    states = [env.get_wrapper_attr("save_state")()]
    for command in targets:
        _, _, _, _, info = env.step(command)
    states.append(env.get_wrapper_attr("save_state")())
    env.close()
    start, end = (StateHashes(physics=s.physics_hash, stages=s.progress_hash) for s in states)
    return start, end, info["stage"]


@pytest.mark.parametrize("policy", ["hold", "random", f"{__name__}:Drifts"])
def test_targets_play_the_episode_again_to_the_bit(play, policy):
    _, results = play(PolicyChoice.parse(policy), episodes=2)
    for one in results.tasks:
        for record in one.records:
            targets = record.targets()
            assert targets.shape == (record.steps, 16)
            again = replayed(one.task, record, targets)
            assert again == (record.start, record.end, record.final_stage)
            targets[-2] += 1e-3
            assert replayed(one.task, record, targets)[1] != record.end


def test_episode_of_a_broken_policy_keeps_what_was_sent(play):
    _, results = play("Faulty", episodes=2, workers=1)
    record = next(one for one in results.tasks if one.task.id == "wave").records[1]
    assert record.error
    assert len(record.targets()) == record.steps == 3
    assert record.start
    assert record.end is None


def test_targets_stand_in_the_file_as_text(play):
    folder, results = play("random", episodes=1)
    record = results.tasks[0].records[0]
    document = json.loads(folder.record(key(folder, record.task, 0)).read_text())
    assert base64.b64decode(document["sent"]) == record.sent
    assert set(document["end"]) == {"physics", "stages"}
