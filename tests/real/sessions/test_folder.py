"""What is written down on the way: by whom, when there is no room, and before anything begins."""

import resource
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.core.errors import BackendError, EvaluationError, OutputError
from duobench.real.sessions.trials_folder import (
    LogEntry,
    LogKind,
    TrialLog,
    TrialsFolder,
    TrialsProgress,
    read_entries,
)
from duobench.real.sessions.trials_report import write_trials_report
from tests.quick_first import quick_first
from tests.real.sessions.operator import Stand, played, records, trials
from tests.real.simulated import SimulatedArm, simulated_rig


@contextmanager
def room_for(size: int) -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_press_that_there_is_no_room_for_is_nowhere(tmp_path: Path) -> None:
    log = TrialLog(tmp_path / "log.jsonl")
    log.add(LogEntry(kind=LogKind.BEGIN, trial=0, attempt=1))
    with room_for(log.path.stat().st_size + 20):
        for stage in (1, 2):
            with pytest.raises(OutputError):
                log.add(LogEntry(kind=LogKind.PRESS, trial=0, attempt=1, stage=stage))
    log.add(LogEntry(kind=LogKind.PRESS, trial=0, attempt=1, stage=3))
    log.close()
    assert [entry.stage for entry in read_entries(log.path)] == [None, 3]
    assert list(read_entries(log.path)) == list(log.entries)


@pytest.mark.slow
def test_every_day_has_its_rater(tmp_path: Path) -> None:
    for number, rater in enumerate(("alice", "bob", ""), 1):
        stand = played(tmp_path / "t", trials(1), rater=rater, episodes=number)
    found = [each.judged.rater for each in records(stand.folder)["A"] if each.judged]
    assert found == ["alice", "bob", "alice"]


def test_arms_that_cannot_be_reached_begin_no_evaluation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_arm: SimulatedArm) -> None:
        raise BackendError("The arm cannot be reached.")

    with monkeypatch.context() as patched:
        patched.setattr(SimulatedArm, "connect", fail)
        with pytest.raises(BackendError):
            Stand(tmp_path / "t", rig=simulated_rig(speed_fraction=0.1))
    Stand(tmp_path / "t", rig=simulated_rig(speed_fraction=0.2)).ending.close()


@pytest.fixture(scope="module")
def two_trials(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An evaluation of two trials; it is copied before anything is done to it."""
    return played(tmp_path_factory.mktemp("whole") / "t", trials(1, 2), episodes=2).folder.path


def record_of(folder: TrialsFolder, number: int) -> Path:
    plan = folder.read_plan()
    return folder.run.record(plan.key(plan.trials()[number]))


def without_record(folder: TrialsFolder) -> None:
    record_of(folder, 1).unlink()


def without_verdict(folder: TrialsFolder) -> None:
    """As a session leaves it that is killed between a record and its line."""
    lines = folder.log_file.read_text().splitlines(keepends=True)
    assert LogKind.VALID in lines[-1]
    folder.log_file.write_text("".join(lines[:-1]))


def without_photo(folder: TrialsFolder) -> None:
    folder.placed(0, 1).unlink()


def without_film(folder: TrialsFolder) -> None:
    shutil.rmtree(folder.run.path / "videos")


@pytest.mark.parametrize(
    ("change", "said", "remaining"),
    quick_first(
        [
            (without_film, "Trials that lack a photo or film: 2, such as number 1.", []),
            (without_record, "counted, have no record now, and come again: 1, such as", [1]),
            (without_verdict, "that does not count, and come again: 1, such as number 2.", [1]),
            (without_photo, "Trials that lack a photo or film: 1, such as number 1.", []),
        ],
        quick=2,
    ),
)
def test_what_is_missing_is_said_everywhere_and_comes_again(
    two_trials: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: Callable[[TrialsFolder], None],
    said: str,
    remaining: list[int],
) -> None:
    folder = TrialsFolder(shutil.copytree(two_trials, tmp_path / "t"))
    assert folder.compared() == ""
    change(folder)
    for verb in ("report", "bundle"):
        main([verb, str(folder.run.path)])
        assert said in " ".join(capsys.readouterr().out.split())
    with pytest.raises(SystemExit):  # nothing of real arms can be played again
        main(["verify", str(folder.run.path)])
    assert said in " ".join(capsys.readouterr().out.split())
    assert said in write_trials_report(folder).differing
    assert said in folder.page.read_text()
    stand = Stand(folder.path, episodes=2)
    stand.ending.close()
    assert said in stand.session.message
    todo = folder.remaining(folder.read_plan(), TrialsProgress.of(folder.read_log()))
    assert [trial.number for trial in todo] == remaining
    assert [number for number in (0, 1) if not record_of(folder, number).exists()] == remaining


def renamed(folder: TrialsFolder) -> None:
    record = record_of(folder, 1)
    record.rename(record.with_name("00002.json"))


def copied(folder: TrialsFolder) -> None:
    shutil.copy(record_of(folder, 0), record_of(folder, 1))


def without_log(folder: TrialsFolder) -> None:
    folder.log_file.unlink()


def half_a_log(folder: TrialsFolder) -> None:
    lines = folder.log_file.read_text().splitlines(keepends=True)
    folder.log_file.write_text("".join(line for line in lines if '"trial":0' in line))


def with_other_presses(folder: TrialsFolder) -> None:
    """The log of another day, on which the same was planned."""
    folder.log_file.write_text(folder.log_file.read_text().replace('"stage":2', '"stage":3'))


def with_another_trial(folder: TrialsFolder) -> None:
    log = folder.open_log("")
    log.add(LogEntry(kind=LogKind.BEGIN, trial=2, attempt=1))
    log.close()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (renamed, "has a record of no episode of its run"),
        (copied, "does not belong to this run: its episode is 0, expected was 1"),
        (without_log, "they do not agree on trial 1; such trials: 2"),
        (half_a_log, "they do not agree on trial 2; such trials: 1"),
        (with_other_presses, "they do not agree on trial 2; such trials: 1"),
        (with_another_trial, "log.jsonl is of another evaluation, or one of trials.json"),
    ],
)
def test_what_no_trial_has_left_is_refused_everywhere(
    two_trials: Path, tmp_path: Path, change: Callable[[TrialsFolder], None], words: str
) -> None:
    folder = TrialsFolder(shutil.copytree(two_trials, tmp_path / "t"))
    change(folder)
    before = {path: path.read_bytes() for path in folder.path.rglob("*.json*")}
    for verb in ("report", "bundle", "verify"):
        with pytest.raises(SystemExit) as ended:
            main([verb, str(folder.run.path)])
        assert words in str(ended.value)
    with pytest.raises(EvaluationError, match=words):
        write_trials_report(folder)
    with pytest.raises(EvaluationError, match=words):
        Stand(folder.path, episodes=2)
    assert {path: path.read_bytes() for path in folder.path.rglob("*.json*")} == before
