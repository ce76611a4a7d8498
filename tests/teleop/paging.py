"""Records episodes through the page: a program in the place of the browser leads both arms."""

from __future__ import annotations

import threading
import time
from contextlib import closing

from duobench.data import Actor, ActorKind, DataSet
from duobench.rig_sessions.teleop_page import TeleopPage, run
from duobench.rig_sessions.teleoperation import Teleoperation, TeleopState, make_recorder
from duobench.teleop.hands import HandDevice
from duobench.web.page import assets
from duobench.web.server import PageServer
from tests.teleop.operator import Operator
from tests.web.pages import TIMEOUT_S, open_page

OPERATOR = Actor(kind=ActorKind.SCRIPTED_OPERATOR, name="follower", device="hands")


def record(task: str, data: DataSet, episodes: int) -> None:
    """Record episodes in lockstep: each control step waits for hands that came over the socket."""
    device = HandDevice(lockstep=True)
    recorder = make_recorder(task, data, OPERATOR)
    session = Teleoperation(recorder, device, episodes=episodes, lockstep=True)
    arrived = threading.Event()

    def take(is_driver: bool, message: bytes) -> str | None:
        assert is_driver
        session.receive(message, time.monotonic())
        arrived.set()
        return None

    with closing(session), closing(PageServer(assets())) as server:
        TeleopPage(session, server)
        server.on_message = take  # as it does, and notes that a message has arrived
        operator = Operator(session)
        with open_page(server.url) as page:
            page.say(kind="drive")
            page.hear_of("role", role="driver")

            def send() -> None:
                if session.state is not TeleopState.OVER:
                    page.connection.send(operator.next_message().decode())
                    assert arrived.wait(TIMEOUT_S)
                    arrived.clear()

            send()
            run(session, send)
