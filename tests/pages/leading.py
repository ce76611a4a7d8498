"""A session that is led from its page in a real browser, in lockstep: its messages are its time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from msgspec import to_builtins
from playwright.sync_api import Page

from duobench.data import Actor, ActorKind, DataSet
from duobench.teleop.messages import Hands, Message
from duobench.teleop.teleop_page import TeleopPage
from duobench.teleop.teleoperation import Teleoperation
from duobench.web.page import assets
from duobench.web.server import PageServer
from tests.pages.driving import opened, take_the_drive
from tests.pages.windows import complaints_of
from tests.teleop.paging import lockstep_session

SHOWN = 10
"""Turns after which the page is shown where everything is: without a graphics card it has little
time for anything else."""
TIME_LIMIT_S = 1800.0
"""Simulated seconds that an episode may take. While a browser without a graphics card draws and the
program waits for it, the page goes on to send sixty messages a second, each of which is a control
step."""
MOST_TURNS = 80_000
"""Turns that it may take, however slow the machine is."""
MOST_SILENT_S = 120
"""Seconds in which a page that drives says something."""


class Led:
    """A session, its page, and what the page has sent."""

    def __init__(self, session: Teleoperation, server: PageServer, page: Page) -> None:
        self.session, self.page = session, page
        self._server = server
        self.samples: list[dict[str, Any]] = []
        """Every message of hands, in order."""
        self.shown_every: int | None = SHOWN
        """Turns after which the page is shown where everything is; None for never by itself."""
        self._arrivals: list[float] = []
        self._live, self._turns = TeleopPage(session, server), 0
        self.show = self._live.show
        self._give = server.on_message
        self._heard = time.monotonic()
        server.on_message = self._take

    def turn(self, wait_s: float = 1.0) -> None:
        """One turn of the session's loop."""
        assert self._turns < MOST_TURNS, self.session.status()
        assert time.monotonic() - self._heard < MOST_SILENT_S, self.session.status()
        self.session.wait(wait_s)
        self.session.advance(time.monotonic())
        self._turns += 1
        if self.shown_every and self._turns % self.shown_every == 0:
            self.show()

    def follow(self, messages: int = 2) -> None:
        """Go on until that many messages are executed that the page sends after now."""
        last = len(self.samples) + messages - 1
        while len(self.samples) <= last or (self._executed_s < self._arrivals[last]):
            self.turn()

    def begin(self) -> None:
        """Begin to count the turns of the next episode."""
        self._turns = 0

    def cut(self) -> None:
        """Cut the connection of who drives, as a network does: nobody says goodbye."""
        driver = self._server._driver
        assert driver is not None
        self._server._server.call(driver.drop)

    @property
    def _executed_s(self) -> float:
        newest = self.session.device.sampled_s
        return -1.0 if newest is None else newest

    def _take(self, message: Message) -> str | None:
        if isinstance(message, Hands):
            self._heard = time.monotonic()
            self._arrivals.append(self._heard)
            self.samples.append(to_builtins(message))
        return self._give(message)


@contextmanager
def led(
    folder: Path,
    task: str,
    actor: Actor,
    window: dict[str, int],
    *scripts: Path | str,
    episodes: int = 1,
) -> Iterator[Led]:
    """A session whose page is open and drives; it must have nothing to complain."""
    data = DataSet.open(folder)
    with (
        closing(
            lockstep_session(task, data, actor=actor, episodes=episodes, time_limit_s=TIME_LIMIT_S)
        ) as session,
        closing(PageServer(assets())) as server,
        opened(*scripts) as page,
    ):
        one = Led(session, server, page)
        complaints = complaints_of(page)
        page.set_viewport_size(window)  # pyright: ignore[reportArgumentType]
        take_the_drive(page, server.url, one.show)
        yield one
        assert complaints == []


def follower(device: str) -> Actor:
    """A program that leads in the place of a person."""
    return Actor(kind=ActorKind.SCRIPTED_OPERATOR, name="follower", device=device)
