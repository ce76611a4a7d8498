from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from duobench.core.spatial import SE3
from duobench.data import Actor
from duobench.teleop.hands import HandDevice
from duobench.teleop.teleop_page import PERIOD_S, Timings, run
from duobench.teleop.teleoperation import Teleoperation, TeleopState, make_recorder
from tests.teleop.operator import hand, message, said
from tests.teleop.paging import lockstep_session

STEPS = 15


@pytest.fixture
def session() -> Iterator[Teleoperation]:
    env = make_recorder("bin_sort", None, Actor(), time_limit_s=STEPS * PERIOD_S)
    made = Teleoperation(env, HandDevice(), episodes=1)
    yield made
    made.close()


def squeeze(session: Teleoperation, stop: threading.Event) -> None:
    """Send hands sixty times a second, as a page does: open until that was seen, then squeezed."""
    number = 0
    while not stop.is_set():
        is_asked = session.state is not TeleopState.WAITING or "Lead" in session.note
        one = hand(SE3(), squeeze=float(is_asked))
        now = time.monotonic()
        session.receive(said(message(number, one, one, sent=1000.0 * now)), now)
        number += 1
        time.sleep(1 / 60)


@pytest.mark.parametrize("work_s", [0.0, 2 * PERIOD_S])
def test_a_late_loop_slows_simulated_time_and_leaves_no_step_out(
    session: Teleoperation, work_s: float
) -> None:
    stop, steps = threading.Event(), []
    sender = threading.Thread(target=squeeze, args=(session, stop))
    sender.start()

    def look() -> None:
        steps.append(session.status()["step"])
        time.sleep(work_s)

    def is_stopped() -> bool:
        return session.state is TeleopState.DECIDE

    start = time.monotonic()
    timings = run(session, look, is_stopped=is_stopped)
    elapsed = time.monotonic() - start
    stop.set()
    sender.join()
    recorded = [step for step in steps if step]
    assert recorded == list(range(1, STEPS + 1))
    assert elapsed >= STEPS * max(PERIOD_S, work_s)
    assert len(timings.periods) == STEPS
    assert timings.latencies
    said = timings.summary()
    assert 0 < said["latency_ms"]["p50"] <= said["latency_ms"]["max"]
    assert timings.latency_ms is not None
    backend = session.env.base.backend
    assert backend.time == pytest.approx(STEPS * PERIOD_S)


def test_in_lockstep_a_session_waits_for_its_messages() -> None:
    session = lockstep_session("bin_sort", None, time_limit_s=STEPS * PERIOD_S)
    steps = []

    def send() -> None:
        """The next message comes when the page has seen what the last one did."""
        steps.append(session.status()["step"])
        one = hand(SE3(), squeeze=float(len(steps) > 1))
        session.receive(said(message(len(steps), one, one)), time.monotonic())

    send()
    run(session, send, is_stopped=lambda: session.state is TeleopState.DECIDE)
    assert steps[-1] == STEPS
    assert sorted(set(steps)) == list(range(STEPS + 1))
    session.close()


def test_times_are_none_before_the_first_step() -> None:
    assert (Timings().summary(), Timings().latency_ms) == ({}, None)
