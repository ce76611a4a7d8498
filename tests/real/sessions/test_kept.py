"""What an evaluation on real arms keeps beside its records: recordings, and the doctor's word."""

from pathlib import Path
from typing import Any

import pytest

from duobench.core.errors import MessageError
from duobench.data import DataSet, find_problems
from duobench.real.doctor.checks import Check, CheckOutcome, write_checks
from duobench.real.sessions.messages import Stage
from duobench.real.sessions.trials_report import write_trials_report
from duobench.results.folder import RunFolder
from duobench.world.robot.cameras import POLICY_CAMERAS
from tests.quick_first import quick_first
from tests.real.sessions import toys
from tests.real.sessions.operator import (
    LAST,
    POLICIES,
    STEPS,
    Operator,
    Stand,
    only_record,
    played,
    records,
    run,
    trials,
)
from tests.real.simulated import simulated_rig

EPISODES = 2
JUDGED = [2, 0, 3, 1]
"""The stage that the operator sees in each trial that counts, in order."""


def script(operator: Operator) -> None:
    operator.begin()
    operator.play([[4]])
    operator.invalid("A person came into the way.")
    for stage in JUDGED:
        operator.begin()
        operator.play([[], [stage] if stage else []])
        operator.finish()


@pytest.mark.long
def test_trials_that_count_are_recorded_as_they_were_judged(tmp_path: Path) -> None:
    data = DataSet.open(tmp_path / "data")
    stand = played(tmp_path / "trials", script, POLICIES, episodes=EPISODES, data=data)
    assert find_problems(data) == []
    recordings = list(data.recordings())
    kept = [each for each in recordings if each.info.outcome and each.info.outcome.kept]
    judged = {
        (record.policy.rpartition(":")[2].lower(), record.seed): record
        for found in records(stand.folder).values()
        for record in found
    }
    assert len(kept) == len(judged) == len(JUDGED)
    for recording in kept:
        record = judged[recording.info.actor.name, recording.info.seed]
        assert len(recording) == record.steps == STEPS
        assert recording.stage[-1] == record.final_stage
        assert recording.info.outcome is not None
        assert recording.info.outcome.success is record.success
        assert recording.info.rig is not None
        assert tuple(recording.info.videos) == POLICY_CAMERAS
    assert len(recordings) == len(kept)  # nothing of the invalid one


@pytest.mark.parametrize("holds", quick_first([True, False]))
def test_what_is_corrected_in_judging_is_in_the_recording(tmp_path: Path, holds: bool) -> None:
    def corrected(operator: Operator) -> None:
        operator.begin()
        operator.play([[4], [None], [1]])
        count = len(operator.status["presses"])
        operator.say("stage", stage=3, time_s=0.2)
        operator.until(lambda status: len(status["presses"]) == count + 1)
        operator.press(LAST)
        operator.finish(holds=holds)

    data = DataSet.open(tmp_path / "data")
    record, _ = only_record(played(tmp_path / "trials", corrected, data=data))
    (episode,) = data.recordings()
    outcome = episode.info.outcome
    assert outcome is not None
    assert (outcome.success, outcome.stage, outcome.kept) == (True, LAST, True)
    assert (record.success_at_end, episode.success_at_end[-1]) == (holds, holds)
    assert record.stage_changes == ((6, 3), (STEPS, LAST))
    assert episode.stage.tolist() == [0] * 7 + [3] * (STEPS - 7) + [LAST]
    assert find_problems(data) == []


def test_success_that_is_seen_in_the_film_is_in_the_recording(tmp_path: Path) -> None:
    def corrected(operator: Operator) -> None:
        operator.begin()
        operator.play([])
        operator.say("stage", stage=LAST, time_s=0.2)
        operator.until(lambda status: status["presses"])
        operator.finish()

    data = DataSet.open(tmp_path / "data")
    played(tmp_path / "trials", corrected, data=data)
    (episode,) = data.recordings()
    assert episode.success_step == 7
    assert find_problems(data) == []


def test_session_that_is_stopped_in_judging_leaves_no_half_recording(tmp_path: Path) -> None:
    def stopped(operator: Operator) -> None:
        operator.begin()
        operator.play([[1]])
        operator.stand.session.stop()

    data = DataSet.open(tmp_path / "data")
    stand = played(tmp_path / "trials", stopped, is_complete=False, data=data)
    assert find_problems(data) == []
    assert stand.folder.invalid_film(0, 1).exists()
    stand = played(tmp_path / "trials", trials(1), data=data)
    assert find_problems(data) == []
    assert len(data.episodes()) == 1
    assert not stand.folder.invalid_film(0, 2).exists()


def test_policy_that_fails_before_its_first_step_leaves_no_recording(tmp_path: Path) -> None:
    def failed(operator: Operator) -> None:
        operator.start()
        operator.phase("judging")
        operator.finish()

    data = DataSet.open(tmp_path / "data")
    policies = [(f"{toys.MODULE}:Unready", "")]
    record, _ = only_record(played(tmp_path / "trials", failed, policies, data=data))
    assert "no model" in (record.error or "")
    assert (data.episodes(), find_problems(data)) == ([], [])


def test_press_while_a_closed_trial_is_written_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = RunFolder.write

    def slowly(*given: Any) -> None:
        with pytest.raises(MessageError, match="Not now"):
            stand.session.take(Stage(stage=3))
        write(*given)

    monkeypatch.setattr(RunFolder, "write", slowly)
    stand = Stand(tmp_path / "trials")
    with stand.ending:
        assert run(stand, trials(1))
    record, judged = only_record(stand)
    assert (record.final_stage, len(judged.presses)) == (1, 1)


@pytest.mark.parametrize(
    ("doctor", "said"),
    [
        (None, "Nobody asked"),
        ((CheckOutcome.OK, "same"), "no check failed"),
        ((CheckOutcome.FAILED, "same"), "found what fails: holding"),
        ((CheckOutcome.OK, "other"), "another rig"),
    ],
)
def test_page_says_what_the_doctor_found(
    tmp_path: Path, doctor: tuple[CheckOutcome, str] | None, said: str
) -> None:
    if doctor is not None:
        outcome, rig = doctor
        known = simulated_rig()
        check = Check(name="holding", outcome=outcome, value="both arms")
        rig_hash = known.hash if rig == "same" else "0" * 64
        write_checks(tmp_path / "trials", known.name, rig_hash, [check])
    stand = Stand(tmp_path / "trials", POLICIES)
    stand.ending.close()
    write_trials_report(stand.folder)
    assert said in stand.folder.page.read_text().replace("\n", " ")
