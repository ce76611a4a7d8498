"""Every task is solved through the page's socket by hands that follow the expert's tools."""

from __future__ import annotations

import json
import time
from contextlib import closing
from pathlib import Path

import pytest

import duobench
from duobench.data import Actor, ActorKind, DataSet, find_problems
from duobench.evaluation.policies import ExpertPolicy
from duobench.randomness import TRAIN, episode_seed
from duobench.rig_sessions.teleop_page import LiveSession
from duobench.rig_sessions.teleop_recorder import make_recorder
from duobench.rig_sessions.teleoperation import Session, State
from duobench.tasks import catalog
from duobench.teleop.hands import HandDevice
from duobench.types import CONTROL_HZ
from duobench.web.server import PageServer
from tests.teleop.operator import Operator
from tests.web.pages import TIMEOUT_S, open_page

MORE_STEPS = 60
"""Control steps that the operator may take beyond those of the expert."""


def expert_steps(task: str, number: int) -> int:
    """Control steps of the plain expert until it solves a train layout."""
    env = duobench.make(task, cameras=False, split=TRAIN)
    expert = ExpertPolicy(env)
    seed = episode_seed(task, number, TRAIN)
    observation, info = env.reset(seed=seed)
    expert.reset(info["instruction"], seed)
    steps, is_over = 0, False
    while not is_over:
        observation, _, terminated, truncated, info = env.step(expert.act(observation)[0])
        steps, is_over = steps + 1, terminated or truncated
    env.close()
    assert info["success"]
    return steps


@pytest.mark.parametrize("task", catalog.names())
def test_hands_that_follow_an_experts_tools_solve_the_task(tmp_path: Path, task: str) -> None:
    data = DataSet.open(tmp_path)
    actor = Actor(kind=ActorKind.SCRIPTED_OPERATOR, name="follower", device="hands")
    device = HandDevice(lockstep=True)
    session = Session(make_recorder(task, data, actor), device, episodes=1, lockstep=True)
    operator = Operator(session)
    most = expert_steps(task, 0) + MORE_STEPS
    with closing(PageServer({})) as server, open_page(server.url) as page:
        LiveSession(session, server)
        page.say(kind="drive")
        while session.state is not State.OVER:
            page.say(**json.loads(operator.next_message()))
            session.wait(TIMEOUT_S)
            session.advance(time.monotonic())
            if session.state is State.RECORDING:
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
