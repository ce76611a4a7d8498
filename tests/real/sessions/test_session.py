import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from duobench.core.errors import EvaluationError, LockedError, OtherRunError, PolicyError
from duobench.core.files import locked
from duobench.core.types import Side
from duobench.policy import interruptible
from duobench.policy.interruptible import GIVEN_UP
from duobench.real.sessions.session import HELD_BY_OPERATOR, NEVER_COUNTS
from duobench.real.sessions.trials import ASK_AT_END
from duobench.real.sessions.trials_folder import (
    CUT,
    REMOVED,
    LogEntry,
    LogKind,
    TrialsFolder,
    TrialsProgress,
)
from duobench.real.sessions.trials_report import write_trials_report
from duobench.results.labels import REACTION_S, FaultKind
from duobench.results.records import InvalidTrial
from duobench.world.robot.mounts import HOME_JOINTS
from tests.quick_first import quick_first
from tests.real.rigs import once_while_homing, put
from tests.real.sessions import toys
from tests.real.sessions.operator import (
    LAST,
    ONE,
    POLICIES,
    STEPS,
    Operator,
    Stand,
    only_record,
    played,
    records,
    trials,
)
from tests.web.pages import open_page, wait_until


def reasons(stand: Stand) -> list[str]:
    """Why trials were invalid."""
    return [one.reason for one in invalid(stand)]


def invalid(stand: Stand) -> list[InvalidTrial]:
    """Trials that do not count."""
    found = TrialsProgress.of(stand.folder.read_log()).invalid
    return [one for each in found.values() for one in each]


def test_fault_of_the_network_makes_a_trial_invalid_and_it_comes_again(tmp_path: Path) -> None:
    def script(operator: Operator) -> None:
        operator.fail_in_trial(1, "no answer", FaultKind.COMMUNICATION)
        operator.attempt(2)
        assert "no answer" in operator.status["message"]
        operator.recover()
        operator.trial(2)

    stand = played(tmp_path / "t", script)
    record, judged = only_record(stand)
    (one,) = judged.repeated
    assert record.final_stage == 2
    assert "no answer" in one.reason
    assert (one.stage, one.fault, one.is_chosen) == (1, FaultKind.COMMUNICATION, False)
    report = write_trials_report(stand.folder)
    assert report.invalid == ((one.reason, 1),)
    (row,) = report.invalid_by_policy
    assert (row.trials, row.chosen, row.stages[:3]) == (1, 0, (0, 1, 0))
    assert "At stage 1" in stand.folder.page.read_text()
    assert "communication (1)" in stand.folder.run.page.read_text()


@pytest.mark.parametrize(
    ("kind", "told", "counts"),
    quick_first(
        [
            (FaultKind.CONTACT, "counts against the policy", True),
            (FaultKind.LIMIT, "the policy's doing", False),
            (FaultKind.LIMIT, "the policy's doing", True),
        ],
        quick=2,
    ),
)
def test_fault_of_the_policys_doing_counts_unless_the_operator_says_otherwise(
    kind: FaultKind, told: str, counts: bool, tmp_path: Path
) -> None:
    def script(operator: Operator) -> None:
        operator.fail_in_trial(1, "joint_reflex", kind)
        assert told in operator.phase("judging")["message"]
        assert operator.status["reasons"] == []
        if counts:
            operator.finish()
            return
        operator.invalid("Our gains are too soft.")
        operator.stand.session.stop()

    stand = played(tmp_path / "t", script, is_complete=counts)
    if not counts:
        (one,) = invalid(stand)
        assert (one.fault, one.is_chosen, one.stage) == (kind, True, 1)
        return
    record, judged = only_record(stand)
    assert (record.final_stage, record.success, record.truncated) == (1, False, True)
    assert judged.fault is kind
    assert "joint_reflex" in judged.stopped
    assert write_trials_report(stand.folder).policies[0].stops == f"{kind} (1)"
    assert "joint_reflex" in stand.folder.run.page.read_text()


@pytest.mark.parametrize("kind", quick_first([FaultKind.PERSON, FaultKind.CONTROLLER]))
def test_what_a_person_or_our_controller_did_is_asked_about_and_never_counts(
    kind: FaultKind, tmp_path: Path
) -> None:
    def script(operator: Operator) -> None:
        operator.fail_in_trial(2, "User Stop pressed!", kind)
        status = operator.phase("judging")
        assert "User Stop" in status["message"]
        assert "never counts" in status["message"]
        assert len(status["reasons"]) > 1
        operator.say("finish")
        operator.until(lambda status: status["message"] == NEVER_COUNTS)
        operator.invalid("A visitor came near.")
        assert operator.status["reasons"] == []
        operator.recover()
        operator.trial(1)

    stand = played(tmp_path / "t", script)
    record, judged = only_record(stand)
    assert (record.final_stage, judged.fault) == (1, None)
    expected = InvalidTrial(reason="A visitor came near.", stage=2, fault=kind)
    assert judged.repeated == (expected,)
    assert invalid(stand) == [expected]
    write_trials_report(stand.folder)
    assert f"stopped by {kind} (1)" in stand.folder.run.page.read_text()
    assert f"{kind} (1)" in stand.folder.page.read_text()


@pytest.mark.slow
def test_a_stop_while_the_arms_go_home_costs_no_trial(tmp_path: Path) -> None:
    def script(operator: Operator) -> None:
        duo = operator.stand.duo
        put(duo, HOME_JOINTS + 0.2)
        stop = partial(operator.fail, Side.LEFT, "User Stop pressed!", FaultKind.PERSON)
        once_while_homing(duo, stop)
        operator.start()
        operator.until(lambda status: status["fault"])
        assert "User Stop" in operator.phase("ready")["message"]
        operator.recover()
        operator.say("start")
        operator.phase("playing")
        operator.play([[1]])
        operator.finish()

    _, judged = only_record(played(tmp_path / "t", script))
    assert (judged.repeated, judged.fault) == ((), None)


def test_fault_in_the_step_of_the_success_does_not_take_it_back(tmp_path: Path) -> None:
    def stop(operator: Operator) -> None:
        operator.press(LAST)
        operator.fail(Side.LEFT, "User Stop pressed!", FaultKind.PERSON)

    def script(operator: Operator) -> None:
        operator.begin()
        operator.next_chunk()
        operator.next_chunk(lambda: stop(operator))
        assert operator.phase("judging")["reasons"] == []
        operator.finish()

    record, judged = only_record(played(tmp_path / "t", script))
    assert record.success
    assert judged.fault is FaultKind.PERSON


def test_whether_success_held_is_asked_before_a_trial_counts(tmp_path: Path) -> None:
    def script(operator: Operator) -> None:
        operator.begin()
        operator.play([[LAST]])
        operator.say("finish")
        operator.until(lambda status: status["message"] == ASK_AT_END)
        operator.finish(holds=False)

    record, _ = only_record(played(tmp_path / "t", script))
    assert (record.success, record.success_at_end) == (True, False)


@pytest.mark.parametrize("is_late", quick_first([True, False]))
def test_press_long_after_the_end_counts_at_the_last_step_and_is_marked(
    is_late: bool, tmp_path: Path
) -> None:
    def script(operator: Operator) -> None:
        operator.begin()
        operator.play([[2]])
        clock = operator.stand.duo.clock
        if is_late:
            end = clock.now()
            wait_until(lambda: clock.now() > end + REACTION_S)
        operator.press(LAST)
        operator.say("stage", stage=1, time_s=0.2)
        operator.finish()

    stand = played(tmp_path / "t", script)
    record, judged = only_record(stand)
    assert record.stage_changes == ((0, 2), (STEPS, LAST))
    assert [press.late for press in judged.presses] == [False, is_late, False]
    assert judged.is_late == is_late
    logged = [each.yes for each in stand.folder.read_log() if each.kind is LogKind.PRESS]
    assert logged == [None, is_late or None, None]
    write_trials_report(stand.folder)
    page = stand.folder.run.page.read_text()
    assert ("pressed long after the end" in page) == is_late
    assert ("1: 1 episodes have" in page) == is_late


def test_operator_holds_the_arms_at_once(tmp_path: Path) -> None:
    def hold(operator: Operator) -> None:
        operator.say("hold")
        operator.wait_for_hold()

    def script(operator: Operator) -> None:
        operator.begin()
        operator.next_chunk()
        operator.next_chunk(lambda: hold(operator))
        operator.phase("judging")
        operator.finish()

    record, judged = only_record(played(tmp_path / "t", script))
    assert (record.steps, judged.stopped, judged.fault) == (toys.CHUNK + 1, HELD_BY_OPERATOR, None)


def test_lost_page_holds_the_arms_and_the_trial_does_not_count(tmp_path: Path) -> None:
    def leave(operator: Operator) -> None:
        operator.page.connection.close()
        operator.wait_for_hold()

    def script(operator: Operator) -> None:
        operator.begin()
        operator.next_chunk()
        operator.next_chunk(lambda: leave(operator))
        with open_page(operator.stand.server.url) as page:
            again = Operator(page)
            again.attempt(2)
            again.trial()

    (reason,) = reasons(played(tmp_path / "t", script))
    assert "lost its connection" in reason


def test_silent_page_holds_the_arms(tmp_path: Path) -> None:
    def script(operator: Operator) -> None:
        operator.begin()
        operator.next_chunk(lambda: time.sleep(0.7))
        operator.attempt(2)
        operator.stand.session.stop()

    stand = played(tmp_path / "t", script, is_complete=False, silence_s=0.5)
    (reason,) = reasons(stand)
    assert "gave no sign" in reason


def test_success_that_was_taken_back_does_not_count(tmp_path: Path) -> None:
    """The press of the last stage ended the episode: the policy was cut short."""

    def script(operator: Operator) -> None:
        operator.begin()
        operator.play([[LAST]])
        operator.press(None)
        operator.say("finish")
        operator.until(lambda status: "cut short" in status["message"])
        operator.invalid("I pressed the wrong key.")
        operator.trial(LAST)

    stand = played(tmp_path / "t", script)
    record, _ = only_record(stand)
    assert (record.success, record.steps) == (True, 1)
    assert reasons(stand) == ["I pressed the wrong key."]


def test_late_press_counts_and_policy_that_raises_has_failed(tmp_path: Path) -> None:
    def script(operator: Operator) -> None:
        for _ in range(2):
            status = operator.begin()
            operator.next_chunk()
            operator.next_chunk()
            if "Patient" in status["trial"]["policy"]:
                operator.play([], chunks=2)
            operator.phase("judging")
            operator.press(1)
            operator.finish()

    stand = played(tmp_path / "t", script, [*ONE, (f"{toys.MODULE}:Broken", "")])
    (good,), (broken,) = records(stand.folder).values()
    assert good.stage_changes == ((STEPS, 1),)
    assert (broken.steps, broken.final_stage) == (toys.CHUNK, 1)
    assert "out of ideas" in (broken.error or "")


def test_policy_that_does_not_answer_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It counts against the policy; where it never answers, the next trial of it fails as well."""
    monkeypatch.setattr(interruptible, "PATIENCE_S", 0.1)

    def script(operator: Operator) -> None:
        operator.begin()
        operator.press(2)
        operator.until(lambda status: status["waits"])
        operator.say("hold")
        operator.wait_for_hold()
        operator.say("give_up")
        assert GIVEN_UP in operator.phase("judging")["message"]
        operator.say("give_up")
        assert "Not now" in operator.page.hear_of("refused")["reason"]
        operator.finish()
        operator.start()
        operator.until(lambda status: status["waits"])  # for its reset
        operator.say("give_up")
        operator.phase("judging")
        operator.finish()
        toys.Patient.gate.release()

    stand = played(tmp_path / "t", script, episodes=2)
    ((one, other),) = records(stand.folder).values()
    assert (one.final_stage, other.final_stage) == (2, 0)
    for record in (one, other):
        assert (record.steps, record.success) == (0, False)
        assert GIVEN_UP in (record.error or "")
    ends = [each.time_s for each in stand.folder.read_log() if each.kind is LogKind.END]
    assert ends == [None, None]  # no step was made


def test_session_that_is_stopped_does_not_wait_for_its_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interruptible, "PATIENCE_S", 0.1)

    def script(operator: Operator) -> None:
        operator.begin()
        operator.stand.session.stop()

    assert played(tmp_path / "t", script, is_complete=False).session.is_stopped
    toys.Patient.gate.release()


def test_page_cannot_do_what_is_not_for_now(tmp_path: Path) -> None:
    def check(operator: Operator, words: str, kind: str, **fields: object) -> None:
        operator.say(kind, **fields)
        assert words in operator.page.hear_of("refused")["reason"]

    def check_playing(operator: Operator) -> None:
        check(operator, "stages are 1 to 5", "stage", stage=9)
        check(operator, "no press", "undo")
        check(operator, "Not now", "finish")
        check(operator, "Not now", "invalid", reason="No.")

    def script(operator: Operator) -> None:
        operator.phase("placing")
        check(operator, "Not now", "start")
        check(operator, "Not now", "stage", stage=1)
        check(operator, "refused", "dance")
        check(operator, "refused", "stage", stage=1.5)
        with open_page(operator.stand.server.url) as other:
            other.say(kind="placed")
            assert "You watch" in other.hear_of("refused")["reason"]
        operator.begin()
        operator.next_chunk(lambda: check_playing(operator))
        operator.play([], chunks=STEPS // toys.CHUNK - 1)
        check(operator, "one line", "note", text="a\nb")
        operator.finish()

    record, _ = only_record(played(tmp_path / "t", script))
    assert record.final_stage == 0


@pytest.mark.long
def test_killed_session_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "t"
    command = [sys.executable, "-m", "tests.real.sessions.killed", str(path)]
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
        again.trial(2)

    stand = played(path, script, POLICIES)
    assert reasons(stand) == [CUT]
    assert {record.final_stage for (record,) in records(stand.folder).values()} == {1, 2}


@pytest.mark.parametrize(
    ("end", "is_chosen"), [(None, False), ("", True), ("person", False), ("limit", True)]
)
def test_program_that_ends_after_the_outcome_was_seen_is_told_as_a_choice(
    end: str | None, is_chosen: bool, tmp_path: Path
) -> None:
    Stand(tmp_path / "t").ending.close()
    folder = TrialsFolder(tmp_path / "t")
    log, about = folder.open_log(""), {"trial": 0, "attempt": 1}
    for kind in (LogKind.BEGIN, LogKind.START):
        log.add(LogEntry(kind=kind, **about))
    for stage in (2, 1, None):
        log.add(LogEntry(kind=LogKind.PRESS, **about, stage=stage, step=1))
    fault = FaultKind(end) if end else None
    if end is not None:
        log.add(LogEntry(kind=LogKind.END, **about, fault=fault))
    log.close()
    folder.open_log("").close()
    (one,) = TrialsProgress.of(folder.read_log()).invalid[0]
    assert one == InvalidTrial(reason=CUT, stage=2, fault=fault, is_chosen=is_chosen)


def test_folder_of_another_evaluation_is_left_alone(tmp_path: Path) -> None:
    for episodes in (1, 2):
        Stand(tmp_path / "t", episodes=episodes).ending.close()
    (tmp_path / "v").mkdir()
    (tmp_path / "v" / "thesis.txt").write_text("mine")
    for folder, policies, error, words in (
        ("t", POLICIES, OtherRunError, "this one has policy"),
        ("t", ONE, OtherRunError, "episodes 1 instead of 2"),
        ("u", [("expert", "")], PolicyError, "reads the simulation"),
        ("u", [*ONE, *ONE], EvaluationError, "same name"),
        ("v", ONE, OtherRunError, "not empty"),
    ):
        with pytest.raises(error, match=words):
            Stand(tmp_path / folder, policies)
    with locked(tmp_path / "t"), pytest.raises(LockedError), locked(tmp_path / "t"):
        pass


def test_who_judges_has_a_name_of_one_line(tmp_path: Path) -> None:
    for name in ("a\nb", "a\x1b[2J", " "):
        with pytest.raises(EvaluationError, match="one line"):
            Stand(tmp_path / "t", rater=name)


def test_removed_record_is_played_again(tmp_path: Path) -> None:
    for _ in range(2):
        stand = played(tmp_path / "t", trials(1))
        stand.folder.run.record(only_record(stand)[0].key).unlink()
    assert TrialsProgress.of(stand.folder.read_log()).attempts == {0: 2}
    (one,) = invalid(stand)
    assert (one.reason, one.stage, one.is_chosen) == (REMOVED, 1, True)


@pytest.mark.slow
def test_removal_of_a_record_is_told_by_the_one_that_takes_its_place(tmp_path: Path) -> None:
    stand = played(tmp_path / "t", trials(1))
    stand.folder.run.record(only_record(stand)[0].key).unlink()
    _, judged = only_record(played(tmp_path / "t", trials(1)))
    assert [one.reason for one in judged.repeated] == [REMOVED]


def test_entry_says_only_what_there_is_to_say(tmp_path: Path) -> None:
    stand = Stand(tmp_path / "t")
    stand.ending.close()
    log = stand.folder.open_log("now")
    log.add(LogEntry(kind=LogKind.PRESS, trial=0, attempt=1, stage=None, step=3, time_s=0.1))
    log.close()
    line = stand.folder.log_file.read_text()
    assert line == '{"kind":"press","trial":0,"attempt":1,"step":3,"time_s":0.1,"stage":null}\n'
