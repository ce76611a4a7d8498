"""Every task is solved through the page's socket by hands that follow the expert's tools."""

from collections.abc import Callable
from pathlib import Path

import pytest

from duobench.core.randomness import TRAIN
from duobench.core.types import CONTROL_HZ
from duobench.data import DataSet, find_problems
from duobench.tasks import catalog
from duobench.teleop.teleoperation import Teleoperation, TeleopState
from tests.teleop.paging import OPERATOR, record

MORE_STEPS = 60
"""Control steps that the operator may take beyond those of the expert."""


@pytest.mark.parametrize("task", catalog.names())
def test_hands_that_follow_an_experts_tools_solve_the_task(
    tmp_path: Path, task: str, demonstrations: Callable[..., Path]
) -> None:
    (plain,) = DataSet.open(demonstrations(task, variety="none")).recordings()
    assert plain.success_step is not None
    most = plain.success_step + MORE_STEPS

    def watch(session: Teleoperation) -> None:
        if session.state is TeleopState.RECORDING:
            assert session.status()["step"] <= most, session.status()

    data = DataSet.open(tmp_path)
    session = record(task, data, 1, watch)
    assert session.device.dropped == 0
    (recording,) = data.recordings()
    outcome, info = recording.info.outcome, recording.info
    assert outcome is not None
    assert (outcome.success, outcome.kept, outcome.cut) == (True, True, False)
    assert (info.split, info.actor) == (TRAIN, OPERATOR)
    assert recording.success_step is not None
    assert len(recording) == recording.success_step + CONTROL_HZ
    assert recording.clutch.all()
    assert not find_problems(data)
