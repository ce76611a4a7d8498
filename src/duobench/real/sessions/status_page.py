"""The operator's page: the episode, the outlines, the stages, and the possible actions.

Messages arrive in the server's thread; a page that gives no sign while arms may move holds them.
"""

import queue
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from duobench.core.types import CONTROL_HZ, Array
from duobench.core.video import jpeg
from duobench.printing.sheet import Mark, marks_of
from duobench.real.sessions import messages
from duobench.real.sessions.cameras import head_image
from duobench.real.sessions.overlay import Overlay, project
from duobench.real.sessions.session import (
    CONNECTION_LOST,
    TAKEN_OVER,
    Phase,
    RigSession,
    Stopped,
)
from duobench.teleop.messages import ANYONE
from duobench.web.server import PageServer
from duobench.world.robot.cameras import NATIVE_HEIGHT, NATIVE_WIDTH
from duobench.world.sim.layout import Layout

SILENCE_S = 2.0
"""Seconds without a sign of the operator's page after which the arms are held."""
TURN_S = 0.05
"""Seconds of a turn while a person is waited for."""
LIVE_S = 0.15
"""Seconds from one live image to the next while objects are placed."""
MOVED_RAD = 0.01
"""A joint that moved further makes the ghost be rendered again."""
STATUS_EVERY = 3
"""Control steps from one status of a running episode to the next."""
WATCHING = "You watch: take over to operate the arms."


class StatusPage:
    """The view of a session on a page; it keeps what it shows for later visitors.

    Args:
        session: The session, which takes its operator's word here from now on.
        server: The page, which takes its messages here from now on.
        overlay: Layouts and their images.
        silence_s: Seconds without a sign of the page after which the arms are held.
    """

    def __init__(
        self,
        session: RigSession,
        server: PageServer,
        overlay: Overlay,
        silence_s: float,
    ) -> None:
        self._session = session
        self._server = server
        self._overlay = overlay
        self.more: dict[str, Any] = {}
        """Fields that are shown beside the state of the session."""
        self._silence = silence_s
        self._inbox: queue.Queue[messages.Message] = queue.Queue()
        self._heard = time.monotonic()
        self._layout: Layout | None = None
        self._episode: dict[str, Any] = {}
        self._images: dict[str, str] = {}
        self._film = ""
        self._image_count = 0
        self._next_image = 0.0
        self._ghost_joints: Array | None = None
        session.duo.watch_person(self._look)
        server.listen(
            messages.Message,
            self._take,
            lambda gives_way: session.lose(
                TAKEN_OVER if gives_way else CONNECTION_LOST
            ),
            WATCHING,
            anyone=ANYONE,
        )

    # --- what a session shows --------------------------------------------------------------------

    def begin(self, layout: Layout, episode: Mapping[str, Any]) -> None:
        """Show another episode, and where its objects shall lie."""
        self._layout = layout
        self._images = {}
        self._film = ""
        self._ghost_joints = None
        places = [
            each for each in marks_of(self._overlay.task, layout) if each.on_table
        ]
        shown = [self._footprint(number, each) for number, each in enumerate(places, 1)]
        self._episode = {**episode, "footprints": shown}
        self.publish()

    def offer_sheet(self, name: str, pdf: bytes) -> None:
        """Give the footprints out as a sheet to print, for rigs without cameras."""
        self._episode["sheet"] = self._server.publish_image(f"{name}.pdf", pdf)

    def offer_film(self, name: str, video: bytes) -> None:
        """Show the film of the episode, which is over."""
        self._film = self._server.publish_image(f"{name}.webm", video)

    def publish(self) -> None:
        """Show the session as it is now."""
        session = self._session
        labels = session.judge.labels
        steps = session.judge.steps
        fault = session.duo.fault
        self._server.publish_status(
            {
                "phase": session.phase.value,
                "stage": labels.stage,
                "presses": labels.all,
                "step": steps,
                "time_s": round(steps / CONTROL_HZ, 1),
                "note": session.note,
                "message": session.message,
                "reasons": session.reasons,
                "at_end": session.at_end,
                "waits": session.waits,
                "fault": None if fault is None else fault.text,
                "panel": session.panel.to_json(),
                "image_size": [NATIVE_WIDTH, NATIVE_HEIGHT],
                "images": self._images,
                "film": self._film,
                **self._episode,
                **self.more,
            }
        )

    # --- what a session waits for ----------------------------------------------------------------

    def next(self) -> messages.Message | None:
        """The operator's next message, or None after a turn; the page shows what is there."""
        session = self._session
        if session.is_stopped:
            raise Stopped
        with suppress(queue.Empty):
            return self._inbox.get(timeout=TURN_S)
        clock = session.duo.clock
        clock.wait_until(clock.now() + TURN_S)
        if session.phase in {Phase.PLACING, Phase.READY}:
            self._show_placing()
        self.publish()
        return None

    @contextmanager
    def moving(self) -> Iterator[None]:
        """The page is heard at any time; from now on it must give signs.

        Waiting presses are forgotten, so that no second motion follows.
        """
        self._heard = time.monotonic()
        self._forget()
        try:
            yield
        finally:
            self._forget()

    def _forget(self) -> None:
        """Do nothing of what was pressed and waits."""
        with suppress(queue.Empty):
            while True:
                self._inbox.get_nowait()

    def on_step(self, number: int) -> None:
        """After each control step: show how it goes."""
        if number % STATUS_EVERY == 0:
            self.publish()

    def _look(self) -> None:
        """Hold the arms without a visitor at the page; the watch calls it while anything moves."""
        silent = time.monotonic() - self._heard
        if silent > self._silence:
            self._session.lose(f"The operator's page gave no sign for {silent:.1f} s.")

    def _take(self, message: messages.Message) -> None:
        if isinstance(message, messages.Hold):  # perhaps of one who watches
            self._forget()
        else:
            self._heard = time.monotonic()
        if isinstance(message, messages.Alive):
            return
        if self._session.take(message):
            self.publish()
        else:
            self._inbox.put(message)

    def _show_placing(self) -> None:
        """Show the live image, and the layout over it; the ghost again once an arm has moved."""
        layout = self._layout
        if (
            layout is None
            or not self._server.has_viewers
            or time.monotonic() < self._next_image
        ):
            return
        self._next_image = time.monotonic() + LIVE_S
        image = head_image(self._session.duo)
        if image is not None:
            self._server.publish_frame(jpeg(image))
        joints = self._session.duo.read().joints
        before = self._ghost_joints
        if before is not None and np.max(np.abs(joints - before)) < MOVED_RAD:
            return
        self._ghost_joints = joints.copy()
        for name, made in self._overlay.images(layout, joints).items():
            self._image_count += 1
            self._images[name] = self._server.publish_image(
                f"{name}-{self._image_count}", made
            )

    def _footprint(self, number: int, mark: Mark) -> dict[str, Any]:
        x, y, yaw = (round(value, 1) + 0.0 for value in (mark.x, mark.y, mark.yaw))
        return {
            "number": number,
            "name": mark.name.replace("_", " "),
            "x_mm": x,
            "y_mm": y,
            "yaw_deg": yaw,
            "outlines": [
                self._in_image(outline) for outline in mark.contact or mark.seen
            ],
        }

    def _in_image(self, outline: Array) -> list[list[float]]:
        """An outline on the table in pixels of the head camera; empty where it is behind that."""
        on_table = np.column_stack([outline / 1000.0, np.zeros(len(outline))])
        corners = project(on_table, self._overlay.table_from_head)
        return [] if np.isnan(corners).any() else corners.round(1).tolist()
