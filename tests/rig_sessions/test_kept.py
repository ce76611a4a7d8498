"""What an evaluation on real arms keeps beside its records: recordings, and the doctor's word."""

from pathlib import Path

import pytest

from duobench.data import DataSet, find_problems
from duobench.hardware.doctor.checks import Check, Outcome, write_checks
from duobench.hardware.rig import Rig
from duobench.rig_sessions.trials_report import write_trials_report
from duobench.types import POLICY_CAMERAS
from tests.rig_sessions.operator import POLICIES, STEPS, Operator, Stand, played, records

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


@pytest.mark.parametrize(
    ("doctor", "said"),
    [
        (None, "Nobody asked"),
        ((Outcome.OK, "same"), "no check failed"),
        ((Outcome.FAILED, "same"), "found what fails: holding"),
        ((Outcome.OK, "other"), "another rig"),
    ],
)
def test_page_says_what_the_doctor_found(
    tmp_path: Path, doctor: tuple[Outcome, str] | None, said: str
) -> None:
    if doctor is not None:
        outcome, rig = doctor
        known = Rig.simulated()
        check = Check(name="holding", outcome=outcome, value="both arms")
        rig_hash = known.hash if rig == "same" else "0" * 64
        write_checks(tmp_path / "trials", known.name, rig_hash, [check])
    stand = Stand(tmp_path / "trials", POLICIES, episodes=1)
    stand.ending.close()
    write_trials_report(stand.folder)
    assert said in stand.folder.page.read_text().replace("\n", " ")
