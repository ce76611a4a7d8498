"""Playback in the viewer: one episode at a time, the same for all visitors of the page."""

import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict
from functools import lru_cache
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import DuoBenchError, MessageError
from duobench.core.types import CONTROL_HZ
from duobench.data.reviews import MAX_TEXT
from duobench.evaluation.replay.sources import DataSource, ViewSource
from duobench.evaluation.replay.trajectory import Trajectory
from duobench.web.messages import PageMessage, SelectItem, pack_frame
from duobench.web.server import PageServer

MAX_TRAJECTORIES = 64
"""Episodes that are kept once they were shown; each takes up to a few hundred kilobytes."""
_MAX_COMMANDS = 100
MAX_ITEMS = 2000
_MAX_LATE_S = 1.0
"""Seconds of a pause, such as without a visitor, after which it continues where it was."""
_REFRESH_S = 1.0
"""Seconds between looks for messages."""
_IMAGES_S = 0.2
"""Seconds between images of a rig's cameras."""
_IDLE_S = 0.1
"""Seconds between looks for a ready episode or a new visitor."""


_Step = Annotated[int, msgspec.Meta(ge=0, le=10**9)]


class SeekStep(PageMessage, frozen=True, tag="seek"):
    """Go to a control step."""

    step: _Step


class SetPlaying(PageMessage, frozen=True, tag="play"):
    """Go on, or stop."""

    on: bool


class ReviewTake(PageMessage, frozen=True, tag="review"):
    """Word of a visitor about a recording, at a second look; see `Reviews.add`."""

    id: Annotated[str, msgspec.Meta(max_length=300)]
    by: Annotated[str, msgspec.Meta(max_length=MAX_TEXT)] = ""
    kept: bool | None = None
    note: Annotated[str, msgspec.Meta(max_length=MAX_TEXT)] | None = None
    rows: tuple[_Step, _Step] | None = None
    undo: bool = False


Command = SelectItem | SeekStep | SetPlaying | ReviewTake


class Viewer:
    """Shows a source on a page, its first item at first, and does what its visitors ask for.

    All of them see the same. Nothing moves without a visitor.

    Args:
        source: Items that can be viewed; closed at the end of `run`.
        server: The page, which takes its messages here from now on.
        refresh: Called every second, with whether it is the last time; gives further fields of the
            status, and may add items to the source.
    """

    def __init__(
        self,
        source: ViewSource,
        server: PageServer,
        refresh: Callable[[bool], dict[str, Any]] | None = None,
    ) -> None:
        self._source = source
        self._server = server
        self._refresh_source = refresh
        self._more: dict[str, Any] = {}
        self._list_items()
        self._commands: queue.Queue[Command] = queue.Queue(_MAX_COMMANDS)
        self._loader = ThreadPoolExecutor(1, "viewer")
        self._loading: Future[Trajectory] | None = None
        self._load = lru_cache(MAX_TRAJECTORIES)(source.load)
        self._selected = ""
        self._shown: Trajectory | None = None
        self._poses: NDArray[np.float32] = np.empty((0, 0, 7), np.float32)
        self._step = 0
        self._plays = False
        self._note = ""
        self._due = 0.0
        self._next_images = 0.0
        self._images: list[dict[str, Any]] = []
        self._images_of: tuple[str, int] | None = None
        self._number = 0
        self._over = threading.Event()
        server.listen(Command, self._on_message)
        self._refresh()

    def run(self) -> None:
        """Show until `stop` is called."""
        try:
            while not self._over.is_set():
                self._act()
                if self._refresh_source and time.monotonic() > self._next_refresh:
                    self._refresh()
                self._begin_loaded()
                self._advance()
                self._show_images()
            self._refresh(is_last=True)
        finally:
            self._loader.submit(self._source.close)
            self._loader.shutdown()

    def stop(self) -> None:
        """Let `run` return; for other threads and signal handlers."""
        self._over.set()

    def _list_items(self) -> None:
        items = self._source.items
        self._items = [asdict(item) for item in items[:MAX_ITEMS]]
        self._title = self._source.title
        if len(items) > MAX_ITEMS:
            self._title += f", the first {MAX_ITEMS} of {len(items)} episodes"
        self._known = {item["id"] for item in self._items}

    def _refresh(self, *, is_last: bool = False) -> None:
        if self._refresh_source is not None:
            self._more = self._refresh_source(is_last)
            self._list_items()
        self._next_refresh = time.monotonic() + _REFRESH_S
        if not self._selected and self._items:
            self._select(self._items[0]["id"])
        self._publish()

    # --- what visitors ask for -------------------------------------------------------------------

    def _on_message(self, command: Command) -> str | None:
        """Take a message, in the server's thread; any visitor of the page may choose."""
        if (
            isinstance(command, SelectItem | ReviewTake)
            and command.id not in self._known
        ):
            raise MessageError(f"There is no {command.id!r} to show.")
        if isinstance(command, ReviewTake) and not isinstance(self._source, DataSource):
            raise MessageError("A second look is taken at recordings alone.")
        try:
            self._commands.put_nowait(command)
        except queue.Full:
            return "Too many wishes at once."
        return None

    def _act(self) -> None:
        """Do the next thing that is asked for, or wait for the next frame."""
        wait_s = max(0.0, self._due - time.monotonic()) if self._moves else _IDLE_S
        try:
            command = (
                self._commands.get(timeout=wait_s)
                if wait_s
                else self._commands.get_nowait()
            )
        except queue.Empty:
            return
        match command:
            case SelectItem(id=item):
                self._select(item)
            case SeekStep(step=step):
                self._show(step)
            case SetPlaying(on=on):
                if on and self._step >= self._last:
                    self._show(0)
                self._plays = on and self._last > 0
                self._due = time.monotonic() + 1 / CONTROL_HZ
            case ReviewTake():
                self._review(command)
        self._publish()

    def _review(self, command: ReviewTake) -> None:
        """Write down what a visitor says about a recording; the page shows an error."""
        if not isinstance(self._source, DataSource):
            return
        said = {
            name: getattr(command, name)
            for name in ("by", "kept", "note", "rows", "undo")
        }
        try:
            self._source.review(command.id, **said)
            self._note = "" if self._shown is None else self._shown.note
        except DuoBenchError as error:
            self._note = str(error)
        self._list_items()

    # --- what is shown ---------------------------------------------------------------------------

    @property
    def _last(self) -> int:
        return max(0, len(self._poses) - 1)

    @property
    def _moves(self) -> bool:
        return self._plays and self._server.has_viewers

    def _select(self, item: str) -> None:
        self._selected = item
        self._shown = None
        self._note = "Loading …"
        self._plays = False
        self._poses, self._step = self._poses[:0], 0
        if self._loading is not None:
            self._loading.cancel()
        self._loading = self._loader.submit(self._load, item)
        self._publish()

    def _begin_loaded(self) -> None:
        if self._loading is None or not self._loading.done():
            return
        loading, self._loading = self._loading, None
        try:
            shown = loading.result()
        except DuoBenchError as error:
            self._note = str(error)
        else:
            self._shown = shown
            self._poses = shown.poses()
            self._note = shown.note
            self._plays, self._due = self._last > 0, time.monotonic()
            self._server.publish_scene(shown.scene, shown.scene_data)
            self._show(0)
        self._publish()

    def _advance(self) -> None:
        now = time.monotonic()
        if not self._moves or now < self._due:
            return
        if now - self._due > _MAX_LATE_S:
            self._due = now
        steps = 1 + int((now - self._due) * CONTROL_HZ)
        self._due += steps / CONTROL_HZ
        stage = self._stage
        self._show(self._step + steps)
        if self._step >= self._last:
            self._plays = False
        if not self._plays or self._stage != stage:
            self._publish()

    def _show(self, step: int) -> None:
        if len(self._poses):
            self._step = min(step, self._last)
            frame = pack_frame(self._poses[self._step], self._step, time.monotonic())
            self._server.publish_frame(frame)

    def _show_images(self) -> None:
        """Show what cameras of a rig saw at this step, a few times a second."""
        now = time.monotonic()
        is_due = now >= self._next_images and self._server.has_viewers
        if (
            not isinstance(self._source, DataSource)
            or self._shown is None
            or not is_due
        ):
            return
        self._next_images = now + _IMAGES_S
        place = (self._selected, self._step)
        if self._images_of != place:
            self._images_of = place
            before = self._images
            try:
                found = self._source.images(*place)
            except DuoBenchError as error:
                found, self._note = {}, str(error)
            self._images = [self._about(*each) for each in found.items()]
            if not (before or self._images):
                return
        elif not self._images:
            return
        self._server.publish_cameras(self._images)

    def _about(
        self,
        camera: str,
        image: bytes,
    ) -> dict[str, Any]:
        """A camera's image as the page shows it."""
        self._number += 1
        return {
            "name": camera,
            "title": f"{camera.replace('_', ' ').capitalize()} camera",
            "image": self._server.publish_image(f"camera-{camera}", image),
            "number": self._number,
            "stale_s": None,
        }

    @property
    def _stage(self) -> int:
        return 0 if self._shown is None else self._shown.stage_after(self._step)

    def _publish(self) -> None:
        status: dict[str, Any] = {
            "title": self._title,
            "selected": self._selected,
            "note": self._note,
        }
        shown = self._shown
        if shown is not None:
            status |= {
                "task": shown.task,
                "instruction": shown.instruction,
                "next": shown.next_after(self._step),
                "stage": self._stage,
                "max_stage": len(shown.stages),
                "stages": shown.stages,
                "stage_changes": shown.stage_changes,
                "corrections": shown.corrections,
                "step": self._step,
                "steps": self._last,
                "state": ("playing" if self._plays else "paused")
                if self._last
                else None,
            }
        self._server.publish_items(self._items)
        self._server.publish_status(status | self._more)
