import duobench
from duobench.envs.config import EnvConfig
from duobench.errors import PolicyTimeoutError
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.evaluation.rollout import rollout
from duobench.files import decode, encode
from duobench.policy import PolicyMetadata, make
from duobench.randomness import episode_seed, policy_seed
from duobench.results.limits import TimeLimits
from duobench.results.records import RECORD_SCHEMA, EpisodeRecord
from duobench.results.run import Candidate, Run
from duobench.results.suite import Episode, Suite, find_tasks
from duobench.versions import package_versions, record_versions
from tests.evaluation import toy_tasks

(WAVE,) = find_tasks([toy_tasks.WAVE_NAME])
RUN = Run(
    candidates=(
        Candidate(
            policy="random",
            metadata=PolicyMetadata(name="random", version="7"),
            config=EnvConfig(cameras=()),
        ),
    ),
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
            def on_step(self, step, infos=infos) -> None:
                infos.append(dict(step.info) | {"unmet": env.get_wrapper_attr("unmet")})

        policy = make("hold" if index % 2 else "random")  # which reach other stages
        rollout(env, policy, seed=episode.seed, watchers=[recorder, Keeps(episode)])
        record = recorder.record(RUN, VERSIONS)
        assert decode(encode(record, RECORD_SCHEMA), EpisodeRecord, RECORD_SCHEMA) == record
        stages = [info["stage"] for info in infos]
        assert [record.stage_after(number + 1) for number in range(len(stages))] == stages
        assert record.steps == len(infos)
        assert record.success == infos[-1]["success"] == record.terminated
        assert record.truncated == (not record.terminated)
        assert record.success_at_end == infos[-1]["success_at_end"]
        assert record.clipped == sum(info["clipped"].any() for info in infos)
        assert record.unmet == infos[-1]["unmet"]
        assert bool(record.unmet) == bool(record.missing) == (not record.success)
        assert record.state_hash == env.get_wrapper_attr("state_hash")()
        assert record.seed == episode_seed("wave", index)
        assert record.policy_seed == policy_seed("wave", record.seed)
        assert record.instruction == "Do the wave."
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
    assert (record.success, record.final_stage, record.steps, record.state_hash) == (
        False,
        0,
        0,
        None,
    )
    assert decode(encode(record, RECORD_SCHEMA), EpisodeRecord, RECORD_SCHEMA) == record
