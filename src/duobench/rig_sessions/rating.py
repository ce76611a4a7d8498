"""A second rater looks at the films of trials, and presses stages as the operator did.

Names of policies are hidden, and films come in an order of their own, so that nothing tells which
policy is at work. Every press is on the disk at once; a film whose rating was cut comes again.
"""

from __future__ import annotations

import hashlib
import queue
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import Any

import numpy as np

from duobench.errors import EvaluationError, MessageError
from duobench.results.records import EpisodeRecord, Press
from duobench.rig_sessions import trial_messages as messages
from duobench.rig_sessions.judging import Presses
from duobench.rig_sessions.trial_folder import Standing, TrialsFolder
from duobench.rig_sessions.trial_log import Entry, Kind, TrialLog, press_entry
from duobench.rig_sessions.trial_plan import Plan, Trial
from duobench.types import CONTROL_HZ
from duobench.web.server import PageServer

TURN_S = 0.05
WATCHING = "You watch: take over to rate."


@dataclass(frozen=True, kw_only=True, slots=True)
class Rating:
    """What one rater said about one film."""

    presses: tuple[Press, ...]
    """Every press."""
    stage: int
    """The highest stage that stands."""
    note: str = ""
    """What the rater wrote."""


def rated(entries: Iterable[Entry], max_stage: int) -> dict[tuple[int, int], Rating]:
    """The films that a log of ratings closes, by trial and attempt; the last word counts.

    Args:
        entries: The log of one rater.
        max_stage: The task's last stage.
    """
    found: dict[tuple[int, int], Rating] = {}
    presses, note = Presses(max_stage), ""
    for entry in entries:
        if entry.kind is Kind.BEGIN:
            presses, note = Presses(max_stage), ""
        elif entry.kind is Kind.PRESS:
            press = Press(stage=entry.stage, step=entry.step or 0, time_s=entry.time_s or 0.0)
            presses.add(press)
        elif entry.kind is Kind.NOTE:
            note = entry.text
        elif entry.kind is Kind.VALID:
            key = entry.trial, entry.attempt
            found[key] = Rating(presses=presses.all, stage=presses.stage, note=note)
    return found


class RatingSession:
    """Leads a rater through the films."""

    def __init__(
        self,
        folder: TrialsFolder,
        rater: str,
        server: PageServer,
        *,
        wall: Callable[[], str] = lambda: datetime.now(UTC).isoformat(timespec="seconds"),
    ) -> None:
        """Find what is to be rated.

        Args:
            folder: The evaluation.
            rater: Who rates, by a pseudonym.
            server: The rater's page, which takes its messages here from now on.
            wall: Date and time of day, for the log.

        Raises:
            EvaluationError: There is no evaluation, no film, or the name is none.
            FileError: A file of it is damaged.
        """
        self._folder, self._rater, self._server, self._wall = folder, rater, server, wall
        self._plan: Plan = folder.read_plan()
        standing = Standing.of(folder.read_log())
        path = folder.ratings(rater)
        self.films = [
            (trial, standing.valid[trial.number])
            for trial in _shuffled(self._plan.trials(), rater)
            if trial.number in standing.valid and self._film(trial).exists()
        ]
        """What is rated, in the order in which it comes: a trial, and the attempt that counts."""
        if not self.films:
            raise EvaluationError(f"{folder.path} has no film of a finished trial to rate.")
        self._log = TrialLog(path)
        self._inbox: queue.Queue[messages.Message] = queue.Queue()
        self._over = threading.Event()
        self._lock = threading.Lock()
        self._presses = Presses(self._plan.task.max_stage)
        self._now: tuple[Trial, int] | None = None
        self._shown: dict[str, Any] = {}
        self._last_step = 0
        server.on_message = self._take

    def run(self) -> bool:
        """Have what is missing rated; whether nothing is missing at the end.

        Raises:
            OutputError: Something cannot be written.
        """
        try:
            done = rated(self._log.entries, self._plan.task.max_stage)
            count = len(self.films)
            for place, (trial, attempt) in enumerate(self.films):
                if (trial.number, attempt) not in done and not self._rate(
                    trial, attempt, place, count
                ):
                    return False
        finally:
            self._log.close()
        self._now = None
        self._shown = {"phase": "over", "message": "Every film is rated. Thank you."}
        self._publish()
        return True

    def close(self) -> None:
        """Let go of the log; closing twice is harmless."""
        self._log.close()

    def stop(self) -> None:
        """Let `run` return; for other threads and signal handlers."""
        self._over.set()

    def _rate(self, trial: Trial, attempt: int, place: int, count: int) -> bool:
        """Have one film rated; False if the session was stopped."""
        record = self._record(trial)
        film = self._server.publish_image(f"film-{place}.webm", self._film(trial).read_bytes())
        with self._lock:
            self._now, self._presses = (trial, attempt), Presses(self._plan.task.max_stage)
            self._last_step = record.steps
        self._write(Kind.BEGIN)
        self._shown = {
            "phase": "rating",
            "number": place + 1,
            "of": count,
            "film": film,
            "instruction": record.instruction,
            "message": "",
        }
        self._publish()
        while not self._over.is_set():
            try:
                message = self._inbox.get(timeout=TURN_S)
            except queue.Empty:
                continue
            match message:
                case messages.Note(text=text):
                    self._write(Kind.NOTE, text=text)
                case messages.Finish():
                    self._write(Kind.VALID)
                    return True
                case _:
                    pass
        return False

    def _take(self, is_driver: bool, data: bytes) -> str | None:
        """Take a message, in the server's thread."""
        if not is_driver:
            return WATCHING
        message = messages.read(data)
        match message:
            case messages.Alive():
                return None
            case messages.At(time_s=time_s, stage=stage):
                self._press(stage, time_s)
            case messages.Note() | messages.Finish() if self._now is not None:
                self._inbox.put(message)
            case _:
                raise MessageError("A rater presses stages at a time of the film, and closes it.")
        return None

    def _press(self, stage: int | None, time_s: float) -> None:
        with self._lock:
            if self._now is None:
                raise MessageError("There is no film to rate.")
            trial, attempt = self._now
            step = min(round(time_s * CONTROL_HZ), self._last_step)
            press = Press(stage=stage, step=step, time_s=round(time_s, 3))
            after = Presses(self._plan.task.max_stage, (*self._presses.all, press))
            self._log.add(press_entry(press, trial.number, attempt, self._wall()))
            self._presses = after
        self._publish()

    def _publish(self) -> None:
        presses = self._presses
        self._server.publish_status(
            {
                "title": self._plan.task.title,
                "rater": self._rater,
                "stages": list(self._plan.task.stages),
                "stage": presses.stage,
                "presses": [
                    {"stage": press.stage, "step": press.step, "time_s": press.time_s}
                    for press in presses.all
                ],
                **self._shown,
            }
        )

    def _write(self, kind: Kind, **more: object) -> None:
        if self._now is not None:
            trial, attempt = self._now
            make = partial(Entry, kind=kind, trial=trial.number, attempt=attempt, at=self._wall())
            self._log.add(make(**more))  # pyright: ignore[reportArgumentType]

    def _film(self, trial: Trial) -> Any:
        run_folder = self._folder.run(self._plan.letter(trial.policy))
        return run_folder.video(self._plan.task.id, trial.episode)

    def _record(self, trial: Trial) -> EpisodeRecord:
        run_folder = self._folder.run(self._plan.letter(trial.policy))
        return run_folder.read_record(run_folder.read_run(), self._plan.episode(trial.episode))


def _shuffled(trials: list[Trial], rater: str) -> list[Trial]:
    """The trials in an order that the rater's name decides."""
    seed = int.from_bytes(hashlib.sha256(rater.encode()).digest()[:8], "big")
    order = np.random.default_rng(seed).permutation(len(trials))
    return [trials[place] for place in order.tolist()]
