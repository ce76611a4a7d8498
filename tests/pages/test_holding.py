"""Every page that moves arms: Space and the red bar hold, whoever looks, whatever has the focus."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from dev.tools.pages import PHONE
from duobench.real.sessions.rig_teleoperation import (
    RigTeleoperation,
    RigTeleopPage,
    make_real_recorder,
)
from duobench.real.sessions.session import HELD_BY_OPERATOR, Phase
from duobench.teleop.hands import HandDevice
from duobench.teleop.teleop_page import TeleopPage
from duobench.teleop.teleoperation import HELD, Teleoperation, TeleopState, make_recorder
from duobench.web.page import assets
from duobench.web.server import PageServer
from tests.pages.windows import broken_rules, opened, until
from tests.real.rigs import new_rig
from tests.real.sessions import toys
from tests.real.sessions.operator import ONE, Stand
from tests.teleop.test_real import PERSON, Keys

HELD_S = 0.5
"""Longest time from the press of a key to arms that are held."""


@dataclass
class Session:
    """A session whose arms move, in a thread of its own."""

    url: str
    is_held: Callable[[], bool]
    begin: Callable[[Page], None]
    """Lead until arms may move."""
    go_on: Callable[[Page], None]
    """What lets arms go again that were held."""


def press_next(page: Page, *names: str) -> None:
    """Press what leads to the next step, as often as there are names."""
    for name in names:
        for _ in range(600):
            if page.locator(f"#{name}.next").is_visible():
                break
            page.wait_for_timeout(100)
        else:
            raise AssertionError(f"no {name}: {page.inner_text('main')}")
        page.click(f"#{name}.next")


def lead(page: Page) -> None:
    """Press a key of the scene until the recording runs."""
    page.focus("canvas")
    for _ in range(100):
        page.keyboard.down("PageUp")
        page.wait_for_timeout(200)
        page.keyboard.up("PageUp")
        page.wait_for_timeout(100)
        if page.evaluate("document.querySelector('.state').dataset.state") == "recording":
            return
    raise AssertionError(page.inner_text("main"))


def drive(page: Page) -> None:
    page.wait_for_selector("#drive:visible", timeout=60_000)
    page.click("#drive")


@contextmanager
def running(live: TeleopPage) -> Iterator[None]:
    thread = threading.Thread(target=live.run)
    thread.start()
    try:
        yield
    finally:
        live.stop()
        thread.join()


@contextmanager
def simulation(path: Path) -> Iterator[Session]:
    recorder = make_recorder("bin_sort", path, PERSON)
    with (
        Teleoperation(recorder, HandDevice()) as session,
        closing(PageServer(assets())) as server,
        running(TeleopPage(session, server)),
    ):

        def begin(page: Page) -> None:
            drive(page)
            lead(page)

        def go_on(page: Page) -> None:
            until(page, f"document.querySelector('.note').textContent == {HELD!r}")
            press_next(page, "go_on")
            until(page, "!document.querySelector('#go_on')")

        yield Session(server.url, lambda: session.state is TeleopState.HELD, begin, go_on)


@contextmanager
def rig(path: Path) -> Iterator[Session]:
    duo = new_rig()
    recorder = make_real_recorder(duo, "bin_sort", path, PERSON)
    with (
        closing(recorder),
        RigTeleoperation(recorder, HandDevice(), Keys()) as session,
        closing(PageServer(assets())) as server,
        running(RigTeleopPage(session, server, silence_s=600.0)),
    ):

        def begin(page: Page) -> None:
            drive(page)
            press_next(page, "home", "placed")
            lead(page)

        def go_on(page: Page) -> None:
            press_next(page, "keep", "home", "placed")
            lead(page)

        yield Session(server.url, lambda: duo.held == HELD_BY_OPERATOR, begin, go_on)


@contextmanager
def trials(path: Path) -> Iterator[Session]:
    stand = Stand(path, ONE, episodes=3, silence_s=600.0)
    duo, session = stand.duo, stand.session
    thread = threading.Thread(target=session.run)
    thread.start()

    def begin(page: Page) -> None:
        press_next(page, "home", "placed", "start")
        until(page, "document.querySelector('.state').textContent == 'The policy plays'")
        assert toys.Patient.waiting.acquire(timeout=toys.TIMEOUT_S)

    def go_on(page: Page) -> None:
        toys.Patient.gate.release()
        press_next(page, "start")  # nothing was played: the same trial begins again
        until(page, "document.querySelector('.state').textContent == 'The policy plays'")
        assert toys.Patient.waiting.acquire(timeout=toys.TIMEOUT_S)
        assert session.phase is Phase.PLAYING

    try:
        yield Session(stand.server.url, lambda: duo.held == HELD_BY_OPERATOR, begin, go_on)
    finally:
        session.stop()
        toys.Patient.gate.release(100)
        thread.join()
        stand.ending.close()


NOTED = """{
  const note = (event) => (window.pressed = performance.timeOrigin + event.timeStamp);
  for (const type of ["keydown", "pointerdown"]) addEventListener(type, note, {capture: true});
}"""
"""A page that notes when it was pressed, not when it came to see that."""


def seconds_after(page: Page, act: Callable[[], object], is_so: Callable[[], bool]) -> float:
    """Seconds from a press, as the browser's own clock has it, until something is so."""
    found: list[float] = []

    def watch() -> None:
        end = time.monotonic() + 20.0
        while not is_so():
            assert time.monotonic() < end, "it was never held"
            time.sleep(0.002)
        found.append(time.time())

    watcher = threading.Thread(target=watch)
    watcher.start()
    act()
    watcher.join()
    return found[0] - page.evaluate("window.pressed") / 1000


@pytest.mark.long
@pytest.mark.parametrize("page_of", [simulation, rig, trials])
def test_space_holds_on_every_page_with_arms(
    page_of: Callable[[Path], object], tmp_path: Path, window: Browser
) -> None:
    with ExitStack() as ending:
        session: Session = ending.enter_context(page_of(tmp_path / "out"))  # type: ignore[arg-type]
        page = ending.enter_context(opened(window, session.url, PHONE, script=NOTED))
        session.begin(page)
        other = ending.enter_context(opened(window, session.url, PHONE, script=NOTED))
        other.wait_for_selector("#hold:visible")
        until(other, "document.querySelector('.state').textContent != ''")
        assert broken_rules(other) == []

        def press(where: Page, focus: str) -> Callable[[], object]:
            where.evaluate(f"document.querySelector({focus!r}).focus()")
            return lambda: where.keyboard.press("Space")

        button = "button:not([hidden]):not(:disabled):not(#hold)"
        ways = [
            (page, press(page, button)),
            (other, press(other, "body")),
            (other, lambda: other.click("#hold")),
        ]
        for number, (where, way) in enumerate(ways):
            if number:
                session.go_on(page)
            assert seconds_after(where, way, session.is_held) <= HELD_S
