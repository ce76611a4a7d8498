import re
from pathlib import Path

import duobench
from duobench.evaluation.loop import rollout
from duobench.evaluation.recorder import Recorder, traceback_text
from duobench.evaluation.records import EpisodeRecord
from duobench.evaluation.suite import Trial, describe
from duobench.evaluation.versions import record_versions
from duobench.policy import make
from duobench.randomness import episode_seed
from tests.evaluation import small

(WAVE,) = describe([small.WAVE_NAME])


def test_record_says_what_the_environment_said() -> None:
    env = duobench.make(small.WAVE, cameras=False)
    simulation = env.unwrapped.simulation  # type: ignore[attr-defined]
    reached = set()
    for episode in range(6):
        trial = Trial(task=WAVE, episode=episode)
        recorder = Recorder(trial)
        infos: list[dict] = []

        class Keeps(Recorder):
            def on_step(self, step, infos=infos) -> None:
                infos.append(dict(step.info))

        rollout(env, make("random"), seed=trial.seed, subscribers=[recorder, Keeps(trial)])
        record = recorder.record("random", record_versions(None))
        assert EpisodeRecord.from_json(record.to_json()) == record
        stages = [info["stage"] for info in infos]
        assert [record.stage_after(number + 1) for number in range(len(stages))] == stages
        assert record.steps == len(infos)
        assert record.success == infos[-1]["success"] == record.terminated
        assert record.truncated == (not record.terminated)
        assert record.success_at_end == infos[-1]["success_at_end"]
        assert record.fingerprint == simulation.fingerprint()
        assert record.seed == episode_seed("wave", episode)
        assert record.instruction == "Do the wave."
        assert set(record.layout["poses"]) == {"cube"}
        reached.add(record.final_stage)
    env.close()
    assert len(reached) > 1


def test_episode_that_never_began_still_has_a_record() -> None:
    record = Recorder(Trial(task=WAVE, episode=3)).record("mine", {}, error="boom\n")
    assert (record.success, record.final_stage, record.steps, record.fingerprint) == (
        False,
        0,
        0,
        None,
    )
    assert EpisodeRecord.from_json(record.to_json()) == record


def test_traceback_names_no_folder_of_the_machine() -> None:
    try:
        small.cannot_be_made()
    except ZeroDivisionError as error:
        text = traceback_text(error)
    assert text.endswith("ZeroDivisionError: no weights\n")
    assert 'evaluation/small.py", line ' in text
    assert str(Path(__file__).parents[2]) not in text
    assert not re.search(r'File "/', text)


def test_endless_line_of_a_traceback_is_cut() -> None:
    text = traceback_text(ValueError("x" * 100_000))
    assert len(text) < 1000
    assert text.endswith("x …\n")
