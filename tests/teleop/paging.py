"""Sessions in lockstep, and episodes that are recorded through the page by a program."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from duobench.data import Actor, ActorKind, DataSet
from duobench.teleop.hands import HandDevice
from duobench.teleop.teleop_page import TeleopPage, run
from duobench.teleop.teleoperation import Teleoperation, TeleopState, make_recorder
from duobench.web.page import assets
from duobench.web.server import PageServer
from tests.teleop.operator import Operator
from tests.web.pages import TIMEOUT_S, open_page

OPERATOR = Actor(kind=ActorKind.SCRIPTED_OPERATOR, name="follower", device="hands")


def lockstep_session(
    task: str,
    data: DataSet | Path | None,
    *,
    actor: Actor = OPERATOR,
    episodes: int = 1,
    **options: Any,
) -> Teleoperation:
    """A session in which each control step waits for hands."""
    recorder = make_recorder(task, data, actor, **options)
    return Teleoperation(recorder, HandDevice(lockstep=True), episodes=episodes, lockstep=True)


def record(
    task: str,
    data: DataSet,
    episodes: int,
    watch: Callable[[Teleoperation], None] = lambda _session: None,
) -> Teleoperation:
    """Record episodes with hands that follow an expert's tools and come over the socket.

    What watches is called before each message. Returns the session, which is closed.
    """
    arrived = threading.Event()
    with (
        closing(lockstep_session(task, data, episodes=episodes)) as session,
        closing(PageServer(assets())) as server,
    ):
        TeleopPage(session, server)
        take = server.on_message

        def take_and_note(message: Any) -> None:
            take(message)
            arrived.set()

        server.on_message = take_and_note
        operator = Operator(session)
        with open_page(server.url) as page:
            page.drive()

            def send() -> None:
                if session.state is not TeleopState.OVER:
                    watch(session)
                    page.connection.send(operator.next_message().decode())
                    assert arrived.wait(TIMEOUT_S)
                    arrived.clear()

            send()
            run(session, send)
    return session
