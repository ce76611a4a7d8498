import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from duobench.errors import EvaluationError, LockedError, OtherRunError, PolicyError
from duobench.files import locked
from duobench.hardware.devices import FaultKind
from duobench.results.records import EpisodeRecord
from duobench.rig_sessions.session import HELD_BY_OPERATOR
from duobench.rig_sessions.trials_folder import CUT, TrialsFolder, TrialsProgress
from duobench.rig_sessions.trials_log import LogEntry, LogKind
from duobench.rig_sessions.trials_report import write_trials_report
from duobench.types import Side
from tests.rig_sessions import toys
from tests.rig_sessions.operator import POLICIES, STEPS, Operator, Stand, records, run
from tests.web.pages import open_page

LAST = 5
ONE = [(f"{toys.MODULE}:Patient", "")]


def only_record(stand: Stand) -> EpisodeRecord:
    (record,) = records(stand.folder)["A"]
    return record


def reasons(folder: TrialsFolder) -> list[str]:
    invalid = TrialsProgress.of(folder.read_log()).invalid
    return [reason for each in invalid.values() for reason in each]


def next_chunk() -> None:
    assert toys.Patient.waiting.acquire(timeout=toys.TIMEOUT_S)


def test_fault_of_the_network_makes_a_trial_invalid_and_it_comes_again(tmp_path: Path) -> None:
    stand = Stand(tmp_path / "t", ONE, episodes=1)

    def script(operator: Operator) -> None:
        operator.begin()
        next_chunk()
        operator.press(1)
        stand.duo.arms[Side.LEFT].fail("no answer", FaultKind.COMMUNICATION)  # type: ignore[attr-defined]
        toys.Patient.gate.release()
        operator.until(lambda status: status["trial"]["attempt"] == 2)
        assert "no answer" in operator.status["message"]
        operator.until(lambda status: status["fault"])
        operator.say("recover")
        operator.until(lambda status: not status["fault"])
        operator.begin()
        operator.play([[2]])
        operator.finish()

    with stand.ending:
        assert run(stand, script)
    record = only_record(stand)
    assert record.final_stage == 2
    assert record.judged is not None
    (reason,) = record.judged.repeated
    assert "no answer" in reason
    (entry,) = [each for each in stand.folder.read_log() if each.kind is LogKind.INVALID]
    assert entry.yes is True
    assert write_trials_report(stand.folder).invalid == ((reason, 1),)


def test_reflex_counts_against_the_policy(tmp_path: Path) -> None:
    stand = Stand(tmp_path / "t", ONE, episodes=1)

    def script(operator: Operator) -> None:
        operator.begin()
        next_chunk()
        operator.press(1)
        stand.duo.arms[Side.RIGHT].fail("cartesian_reflex")  # type: ignore[attr-defined]
        toys.Patient.gate.release()
        operator.phase("judging")
        assert "counts against the policy" in operator.status["message"]
        operator.finish()

    with stand.ending:
        assert run(stand, script)
    record = only_record(stand)
    assert (record.final_stage, record.success, record.truncated) == (1, False, True)
    assert record.judged is not None
    assert record.judged.reflex
    assert "cartesian_reflex" in record.judged.stopped
    report = write_trials_report(stand.folder)
    assert report.policies[0].reflexes == 1
    assert "cartesian_reflex" in stand.folder.run.page.read_text()


def test_operator_holds_the_arms_at_once(tmp_path: Path) -> None:
    stand = Stand(tmp_path / "t", ONE, episodes=1)

    def script(operator: Operator) -> None:
        operator.begin()
        next_chunk()
        operator.say("hold")
        while stand.duo.held is None:
            pass
        toys.Patient.gate.release()
        operator.phase("judging")
        operator.finish()

    with stand.ending:
        assert run(stand, script)
    record = only_record(stand)
    assert record.steps == 1
    assert record.judged is not None
    assert record.judged.stopped == HELD_BY_OPERATOR
    assert not record.judged.reflex


def test_lost_page_holds_the_arms_and_the_trial_does_not_count(tmp_path: Path) -> None:
    stand = Stand(tmp_path / "t", ONE, episodes=1)

    def script(operator: Operator) -> None:
        operator.begin()
        next_chunk()
        operator.page.connection.close()
        while stand.duo.held is None:
            pass
        toys.Patient.gate.release()
        with open_page(stand.server.url) as page:
            again = Operator(page)
            again.until(lambda status: status["trial"]["attempt"] == 2)
            again.begin()
            again.play([])
            again.finish()

    with stand.ending:
        assert run(stand, script)
    (reason,) = reasons(stand.folder)
    assert "lost its connection" in reason


def test_silent_page_holds_the_arms(tmp_path: Path) -> None:
    stand = Stand(tmp_path / "t", ONE, episodes=1, silence_s=0.5)

    def script(operator: Operator) -> None:
        operator.begin()
        next_chunk()
        threading.Event().wait(0.7)
        toys.Patient.gate.release()
        operator.until(lambda status: status["trial"]["attempt"] == 2)
        stand.session.stop()

    with stand.ending:
        assert not run(stand, script)
    (reason,) = reasons(stand.folder)
    assert "gave no sign" in reason


def test_success_that_was_taken_back_does_not_count(tmp_path: Path) -> None:
    """The press of the last stage ended the episode: the policy was cut short."""
    stand = Stand(tmp_path / "t", ONE, episodes=1)

    def script(operator: Operator) -> None:
        operator.begin()
        operator.play([[LAST]])
        operator.press(None)
        operator.say("finish")
        operator.until(lambda status: "cut short" in status["message"])
        operator.invalid("I pressed the wrong key.")
        operator.begin()
        operator.play([[LAST]])
        operator.finish()

    with stand.ending:
        assert run(stand, script)
    record = only_record(stand)
    assert record.success
    assert record.steps == 1
    assert reasons(stand.folder) == ["I pressed the wrong key."]


def test_late_press_counts_and_policy_that_raises_has_failed(tmp_path: Path) -> None:
    stand = Stand(tmp_path / "t", [*ONE, (f"{toys.MODULE}:Broken", "")], episodes=1)

    def script(operator: Operator) -> None:
        for _ in range(2):
            status = operator.begin()
            for _ in range(2):  # chunks
                next_chunk()
                toys.Patient.gate.release()
            if "Patient" in status["trial"]["policy"]:
                operator.play([], chunks=2)
            operator.phase("judging")
            operator.press(1)
            operator.finish()

    with stand.ending:
        assert run(stand, script)
    (good,), (broken,) = records(stand.folder).values()
    assert good.stage_changes == ((STEPS, 1),)
    assert (broken.steps, broken.final_stage) == (toys.CHUNK, 1)
    assert "out of ideas" in (broken.error or "")


def test_page_cannot_do_what_is_not_for_now(tmp_path: Path) -> None:
    stand = Stand(tmp_path / "t", ONE, episodes=1)

    def refusal(operator: Operator, kind: str, **fields: object) -> str:
        count = len(operator.refused)
        operator.say(kind, **fields)
        while len(operator.refused) == count:
            message = operator.page.hear()
            if message["kind"] == "refused":
                operator.refused.append(message["reason"])
        return operator.refused[-1]

    def script(operator: Operator) -> None:
        operator.phase("placing")
        assert "Not now" in refusal(operator, "start")
        assert "Not now" in refusal(operator, "stage", stage=1)
        assert "refused" in refusal(operator, "dance")
        assert "refused" in refusal(operator, "stage", stage=1.5)
        with open_page(stand.server.url) as other:
            other.say(kind="placed")
            assert "You watch" in other.hear_of("refused")["reason"]
        operator.begin()
        next_chunk()
        assert "stages are 1 to 5" in refusal(operator, "stage", stage=9)
        assert "no press" in refusal(operator, "undo")
        assert "Not now" in refusal(operator, "finish")
        toys.Patient.waiting.release()
        operator.play([])
        assert "one line" in refusal(operator, "note", text="a\nb")
        operator.finish()

    with stand.ending:
        assert run(stand, script)
    assert only_record(stand).final_stage == 0


def test_killed_session_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "t"
    command = [sys.executable, "-m", "tests.rig_sessions.killed", str(path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        with open_page(child.stdout.readline().strip()) as page:
            operator = Operator(page)
            operator.begin()
            operator.press(1)
            child.stdin.write("\n" * (STEPS // toys.CHUNK))
            child.stdin.flush()
            operator.phase("judging")
            operator.finish()
            operator.begin()
            operator.press(3)
            child.send_signal(signal.SIGKILL)
            child.wait()
    with (path / "log.jsonl").open("ab") as log:
        log.write(b'{"kind":"press","tri')  # as a machine leaves it whose power fails
    entries = TrialsFolder(path).read_log()
    assert [entry.stage for entry in entries if entry.kind is LogKind.PRESS] == [1, 3]

    def script(again: Operator) -> None:
        assert again.phase("placing")["trial"]["attempt"] == 2
        again.begin()
        again.play([[2]])
        again.finish()

    stand = Stand(path, POLICIES, episodes=1)
    with stand.ending:
        assert run(stand, script)
    assert reasons(stand.folder) == [CUT]
    stages = {record.final_stage for (record,) in records(stand.folder).values()}
    assert stages == {1, 2}


def test_folder_of_another_evaluation_is_left_alone(tmp_path: Path) -> None:
    stand = Stand(tmp_path / "t", ONE, episodes=1)
    stand.ending.close()
    with pytest.raises(OtherRunError, match="this one has policy"):
        Stand(tmp_path / "t", POLICIES, episodes=1)
    Stand(tmp_path / "t", ONE, episodes=2).ending.close()
    with pytest.raises(OtherRunError, match="episodes 1 instead of 2"):
        Stand(tmp_path / "t", ONE, episodes=1)
    with pytest.raises(PolicyError, match="reads the simulation"):
        Stand(tmp_path / "u", [("expert", "")])
    with pytest.raises(EvaluationError, match="same name"):
        Stand(tmp_path / "u", [*ONE, *ONE])
    (tmp_path / "v").mkdir()
    (tmp_path / "v" / "thesis.txt").write_text("mine")
    with pytest.raises(OtherRunError, match="not empty"):
        Stand(tmp_path / "v", ONE)
    with locked(tmp_path / "t"), pytest.raises(LockedError), locked(tmp_path / "t"):
        pass


def test_removed_record_is_played_again(tmp_path: Path) -> None:
    def script(operator: Operator) -> None:
        operator.begin()
        operator.play([[1]])
        operator.finish()

    for _ in range(2):
        stand = Stand(tmp_path / "t", ONE, episodes=1)
        with stand.ending:
            assert run(stand, script)
        (record,) = records(stand.folder)["A"]
        stand.folder.run.record(record.key).unlink()
    assert TrialsProgress.of(stand.folder.read_log()).attempts == {0: 2}


def test_entry_says_only_what_there_is_to_say(tmp_path: Path) -> None:
    stand = Stand(tmp_path / "t", ONE, episodes=1)
    stand.ending.close()
    log = stand.folder.open_log("now")
    log.add(LogEntry(kind=LogKind.PRESS, trial=0, attempt=1, stage=None, step=3, time_s=0.1))
    log.close()
    line = stand.folder.log_file.read_text()
    assert line == '{"kind":"press","trial":0,"attempt":1,"step":3,"time_s":0.1,"stage":null}\n'
