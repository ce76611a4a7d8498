"""Every task is solved through the page's socket by hands that follow the expert's tools."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from duobench.data import Actor, ActorKind, DataSet, find_problems
from duobench.randomness import TRAIN
from duobench.rig_sessions.teleop_page import TeleopPage
from duobench.rig_sessions.teleoperation import Teleoperation, TeleopState, make_recorder
from duobench.tasks import catalog
from duobench.teleop.hands import HandDevice
from duobench.types import CONTROL_HZ
from duobench.web.server import PageServer
from tests.teleop.operator import Operator
from tests.web.pages import TIMEOUT_S, open_page

MORE_STEPS = 60
"""Control steps that the operator may take beyond those of the expert."""


@pytest.mark.parametrize("task", catalog.names())
def test_hands_that_follow_an_experts_tools_solve_the_task(
    tmp_path: Path, task: str, demonstrations: Callable[..., Path]
) -> None:
    (plain,) = DataSet.open(demonstrations(task, variety="none")).recordings()
    assert plain.success_step is not None
    data = DataSet.open(tmp_path)
    actor = Actor(kind=ActorKind.SCRIPTED_OPERATOR, name="follower", device="hands")
    device = HandDevice(lockstep=True)
    session = Teleoperation(make_recorder(task, data, actor), device, episodes=1, lockstep=True)
    operator = Operator(session)
    most = plain.success_step + MORE_STEPS
    with closing(PageServer({})) as server, open_page(server.url) as page:
        TeleopPage(session, server)
        page.say(kind="drive")
        while session.state is not TeleopState.OVER:
            page.say(**json.loads(operator.next_message()))
            session.wait(TIMEOUT_S)
            session.advance(time.monotonic())
            if session.state is TeleopState.RECORDING:
                assert session.status()["step"] <= most, session.status()
    session.close()
    assert session.device.dropped == 0
    (recording,) = data.recordings()
    outcome, info = recording.info.outcome, recording.info
    assert outcome is not None
    assert (outcome.success, outcome.kept, outcome.cut) == (True, True, False)
    assert (info.split, info.actor) == (TRAIN, actor)
    assert recording.success_step is not None
    assert len(recording) == recording.success_step + CONTROL_HZ
    assert recording.clutch.all()
    assert not find_problems(data)
