"""A session on a page, over its socket: who leads, who watches, and what both see."""

from __future__ import annotations

import json
import math
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.data import DataSet
from duobench.envs.sim_env import sim_of
from duobench.teleop.teleop_page import LEADING_VIEW, WATCHING, TeleopPage
from duobench.teleop.teleoperation import AWAY, Teleoperation
from duobench.web.geometry import Geometry
from duobench.web.server import PageServer
from tests.teleop.operator import NEITHER, hand, led, message, said
from tests.teleop.paging import lockstep_session
from tests.web.pages import Page, open_page, unpack_frame, wait_until

TASK = "carry_pot"
BOTH = led(left=True, right=True)


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Teleoperation]:
    session = lockstep_session(TASK, DataSet.open(tmp_path))
    yield session
    session.close()


@contextmanager
def running(session: Teleoperation) -> Iterator[PageServer]:
    """The session, running in a thread of its own as `duobench teleop` has it."""
    server = PageServer({})
    live = TeleopPage(session, server)
    thread = threading.Thread(target=live.run)
    thread.start()
    yield server
    live.stop()
    thread.join()
    server.close()


class Driver:
    """Takes the place of the driver, and sends samples of two hands beside each other."""

    def __init__(self, page: Page) -> None:
        self._page, self._number = page, 0
        page.drive()

    def send(self, *, squeeze: float, height: float = 0.0) -> float:
        """When it was sent, by the page's clock."""
        self._number += 1
        both = (hand(SE3.at(0.3, y, height), squeeze=squeeze) for y in (0.2, -0.2))
        sample = json.loads(message(self._number, *both))
        self._page.say(**sample)
        return sample["sent"]


def tool_heights(session: Teleoperation) -> np.ndarray:
    return session.env.base.backend.read().tcp_poses[:, 2]


@pytest.mark.long
def test_whoever_drives_leads_and_the_others_watch(session: Teleoperation) -> None:
    with running(session) as server, open_page(server.url) as page, open_page(server.url) as other:
        other.say(kind="keep")
        assert other.hear_of("refused")["reason"] == WATCHING
        driver, before = Driver(page), tool_heights(session)
        driver.send(squeeze=0)
        for number in range(20):
            driver.send(squeeze=1, height=0.005 * number)
        for _ in range(30):
            driver.send(squeeze=1, height=0.095)
        shown = other.hear_of("status", step=50)
        np.testing.assert_allclose(tool_heights(session) - before, 0.095, rtol=0, atol=0.002)
        assert (shown["state"], shown["clutch"]) == ("recording", BOTH)
        assert shown["instruction"].startswith("Lift the pot by both handles")
        assert set(shown["tools"]) == {"left", "right"}


@pytest.mark.slow
def test_frames_show_where_the_bodies_are(session: Teleoperation) -> None:
    with running(session) as server, open_page(server.url) as page:
        simulation = sim_of(session.env).simulation
        geometry = Geometry(simulation.model, cameras=True, view=LEADING_VIEW)
        assert page.hear_of("scene")["name"] == geometry.name
        poses, step, _ = unpack_frame(page.frame())
        np.testing.assert_allclose(poses, geometry.poses(simulation.data), rtol=0, atol=1e-6)
        assert step == 0


def test_a_frame_says_which_sample_it_shows(session: Teleoperation) -> None:
    with running(session) as server, open_page(server.url) as page:
        assert math.isnan(shown_ms(page.frame()))
        driver = Driver(page)
        driver.send(squeeze=0)
        sent = driver.send(squeeze=1)
        while math.isnan(shown := shown_ms(page.frame())):
            pass
        assert shown == sent


def shown_ms(frame: bytes) -> float:
    return struct.unpack_from("<d", frame, 16)[0]


def test_a_driver_who_leaves_lets_go_and_frees_the_place(session: Teleoperation) -> None:
    with running(session) as server:
        with open_page(server.url) as page:
            driver = Driver(page)
            driver.send(squeeze=0)
            driver.send(squeeze=1)
            wait_until(lambda: session.device.clutch == (True, True))
        with open_page(server.url) as next_page:
            Driver(next_page).send(squeeze=1)  # what is still squeezed is no new squeeze
            next_page.hear_of("status", clutch=NEITHER)
            assert session.device.clutch == (False, False)


def test_watchers_are_told_that_the_recording_waits(session: Teleoperation) -> None:
    with running(session) as server, open_page(server.url) as watcher:
        with open_page(server.url) as page:
            driver = Driver(page)
            driver.send(squeeze=0)
            for number in range(10):
                driver.send(squeeze=1, height=0.005 * number)
            watcher.hear_of("status", step=10, state="recording")
        assert watcher.hear_of("status", state="paused")["note"] == AWAY
        with open_page(server.url) as next_page:
            Driver(next_page).send(squeeze=0)
            assert watcher.hear_of("status", state="recording")["note"] == ""


def test_what_is_no_message_is_refused_and_the_session_lives(session: Teleoperation) -> None:
    with running(session) as server, open_page(server.url) as page:
        driver = Driver(page)
        for bad in (
            {"kind": "hands"},
            {"kind": "hands", "sent": 0, "seq": 1, "left": hand(SE3()) | {"squeeze": 2}},
            {"kind": "fly"},
        ):
            page.say(**bad)
            assert page.hear_of("refused")["reason"]
        driver.send(squeeze=0)
        page.hear_of("status", note="Lead a tool to begin.")


def test_nothing_is_computed_while_nobody_looks(
    session: Teleoperation, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[float] = []
    monkeypatch.setattr(Geometry, "poses", lambda _self, _data: asked.append(time.monotonic()))
    with running(session):
        session.receive(said(message(0, hand(SE3()), hand(SE3()))), time.monotonic())
        wait_until(lambda: "Lead" in session.note)
    assert asked == []
