"""What is written down on the way: by whom, when there is no room, and before anything begins."""

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.errors import BackendError, OutputError
from duobench.hardware.drivers.simulated import SimulatedArm
from duobench.hardware.rig import Rig
from duobench.rig_sessions.trials_folder import LogEntry, LogKind, TrialLog, read_entries
from tests.rig_sessions.operator import Operator, Stand, played, records
from tests.rig_sessions.test_session import ONE


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


def test_every_day_has_its_rater(tmp_path: Path) -> None:
    def script(operator: Operator) -> None:
        operator.begin()
        operator.play([[1]])
        operator.finish()

    for number, rater in enumerate(("alice", "bob", ""), 1):
        stand = played(tmp_path / "t", script, ONE, rater=rater, episodes=number)
    found = [each.judged.rater for each in records(stand.folder)["A"] if each.judged]
    assert found == ["alice", "bob", "alice"]


def test_arms_that_cannot_be_reached_begin_no_evaluation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def rig(address: str) -> Rig:
        usual = Rig.simulated()
        arms = {side: replace(arm, address=f"{address}-{side}") for side, arm in usual.arms.items()}
        return replace(usual, arms=arms)

    def fail(_arm: SimulatedArm) -> None:
        raise BackendError("The arm cannot be reached.")

    with monkeypatch.context() as patched:
        patched.setattr(SimulatedArm, "connect", fail)
        with pytest.raises(BackendError):
            Stand(tmp_path / "t", ONE, rig=rig("wrong"), episodes=1)
    Stand(tmp_path / "t", ONE, rig=rig("right"), episodes=1).ending.close()
