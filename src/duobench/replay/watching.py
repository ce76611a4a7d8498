"""A run on a page while it is going on: which worker plays what, and one of them in 3D."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from duobench.errors import MessageError, ServingError
from duobench.replay.commands import Select, read_command
from duobench.replay.live import Live, LiveFrame, LiveScene
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import Episode

if TYPE_CHECKING:
    from duobench.web.server import PageServer

PLAYING, IDLE, OVER = "playing", "", "over"
"""What a worker or a run does, as the page shows it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Playing:
    """What a worker does."""

    worker: int
    """Its number, from 1 on."""
    episode: Episode | None
    """What it plays."""
    stage: int = 0
    """Highest stage of that so far."""


class RunWatch:
    """Shows a run on a page.

    It is an observer of the run, and what executors tell about workers and ask for one to look at.
    A worker is looked at only while somebody has the page open.
    """

    def __init__(self, server: PageServer) -> None:
        """Show it on a page, which takes its messages here from now on."""
        self._server = server
        self._title, self._finished, self._total = "", 0, 0
        self._workers: tuple[Playing, ...] = ()
        self._chosen: int | None = None  # by a visitor
        self._shown: tuple[int, Episode] | None = None
        self._live: LiveFrame | None = None
        self._is_over = False
        self._published: dict[str, Any] = {}
        server.on_message = self._take

    # --- of the run ------------------------------------------------------------------------------

    def on_run_start(self, run: Run, finished: Sequence[EpisodeRecord]) -> None:
        """Say what is played."""
        self._title, self._finished, self._total = run.title, len(finished), run.size
        self._publish()

    def on_episode(self, played: EpisodeRecord) -> None:  # noqa: ARG002 - the protocol's signature
        """Count an episode."""
        self._finished += 1
        self._publish()

    def end(self) -> None:
        """Say that the run is over."""
        self._workers, self._is_over = (), True
        self._publish()

    # --- of the executor -------------------------------------------------------------------------

    @property
    def watched(self) -> int | None:
        """Number of the worker that is looked at; None while nobody looks."""
        if not self._server.has_viewers:
            return None
        playing = [each.worker for each in self._workers if each.episode is not None]
        if self._chosen in playing:
            return self._chosen
        if self._shown is not None and self._shown[0] in playing:
            return self._shown[0]
        return playing[0] if playing else None

    def note(self, workers: Sequence[Playing]) -> None:
        """Take what all workers do."""
        self._workers = tuple(workers)
        self._publish()

    def show(self, worker: int, live: Live) -> None:
        """Take what there is to see of a worker; that of another one than is looked at is late."""
        if worker != self.watched:
            return
        if isinstance(live, LiveScene):
            with suppress(ServingError):  # a worker is not to end the run by what it shows
                self._server.publish_scene(live.name, live.data)
        else:
            self._live = live
            self._server.publish_frame(live.frame)
        self._publish()

    # --- on the page -----------------------------------------------------------------------------

    def _take(self, _is_driver: bool, data: bytes) -> None:
        """Take a message, in the server's thread."""
        command = read_command(data)
        numbers = {str(each.worker): each.worker for each in self._workers}
        if not isinstance(command, Select):
            raise MessageError("An evaluation goes on as it does; one can choose a worker.")
        if command.id not in numbers:
            raise MessageError(f"There is no worker {command.id!r}.")
        self._chosen = numbers[command.id]

    def _publish(self) -> None:
        watched = self.watched
        shown = next((each for each in self._workers if each.worker == watched), None)
        now = None if shown is None or shown.episode is None else (shown.worker, shown.episode)
        if now != self._shown:
            self._shown, self._live = now, None
        status = {
            "title": self._title,
            "note": f"{self._finished} of {self._total} episodes are finished.",
            "items": [_item(each) for each in self._workers],
            "selected": None if watched is None else str(watched),
            **({} if now is None else self._of_episode(now[1])),
            **({"state": OVER} if self._is_over else {}),
        }
        if status != self._published:
            self._published = status
            self._server.publish_status(status)

    def _of_episode(self, episode: Episode) -> dict[str, Any]:
        live = self._live
        stage = 0 if live is None else live.stage
        words = {} if live is None else {"instruction": live.instruction, "next": live.next}
        task = episode.task
        return {
            "task": task.id,
            "state": PLAYING,
            "stage": stage,
            "max_stage": task.max_stage,
            "stages": task.stages,
            "count": episode.index,
            **words,
        }


def _item(playing: Playing) -> dict[str, str]:
    episode = playing.episode
    item = {"id": str(playing.worker), "title": f"Worker {playing.worker}"}
    if episode is None:
        return {**item, "detail": "starting, or waiting", "state": IDLE}
    task = episode.task
    detail = f"{task.id}, episode {episode.index}, stage {playing.stage} of {task.max_stage}"
    return {**item, "detail": detail, "state": PLAYING}
