"""The operator's session: place, play, judge, trial by trial, on one page.

The arms are led in the thread that calls `run`. What the page sends arrives in the server's thread:
presses are judged and written down there at once, and a hold holds there at once; all else waits
until `run` asks for it.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial

import numpy as np

from duobench.errors import BackendError, MessageError
from duobench.fabrication.sheet import layout_sheet
from duobench.files import write
from duobench.hardware.duo import FrankaDuo
from duobench.results.records import Judged, Press
from duobench.rig_sessions import trial_messages as messages
from duobench.rig_sessions.film import NATIVE, Film, HeadCamera
from duobench.rig_sessions.judging import PersonJudge
from duobench.rig_sessions.overlay import Overlay, jpeg
from duobench.rig_sessions.players import Played, Players, Watch
from duobench.rig_sessions.trial_folder import Standing, TrialsFolder
from duobench.rig_sessions.trial_log import Entry, Kind, TrialLog, press_entry
from duobench.rig_sessions.trial_plan import Plan, Trial
from duobench.rig_sessions.trial_status import Board, Phase
from duobench.sim.layout import Layout
from duobench.web.server import PageServer

SILENCE_S = 2.0
"""Seconds without a sign of the operator's page after which the arms are held."""
TURN_S = 0.05
"""Seconds of a turn while a person is waited for."""
LIVE_S = 0.15
"""Seconds from one live image to the next while objects are placed."""
MOVED_RAD = 0.01
"""A joint that moved further makes the ghost be rendered again."""
WATCHING = "You watch: take over to operate the arms."
HELD_BY_OPERATOR = "The operator held the arms."
_ALLOWED: dict[Phase, tuple[type, ...]] = {
    Phase.PLACING: (messages.Placed, messages.Home, messages.Recover),
    Phase.READY: (messages.PlaceAgain, messages.Start, messages.Home, messages.Recover),
    Phase.MOVING: (),
    Phase.PLAYING: (messages.Stage, messages.Undo),
    Phase.JUDGING: (
        *(messages.Stage, messages.Undo, messages.AtEnd, messages.Note),
        *(messages.Finish, messages.Invalid),
    ),
    Phase.OVER: (),
}
"""What the operator may ask for, beside a hold."""


class Stopped(Exception):  # noqa: N818 - no error: a person ended the session
    """The session was stopped."""


class TrialsSession:
    """Leads an operator through the trials of a plan."""

    def __init__(  # noqa: PLR0913 - its parts
        self,
        folder: TrialsFolder,
        plan: Plan,
        players: Players,
        judge: PersonJudge,
        duo: FrankaDuo,
        overlay: Overlay,
        server: PageServer,
        *,
        silence_s: float = SILENCE_S,
        wall: Callable[[], str] = lambda: datetime.now(UTC).isoformat(timespec="seconds"),
    ) -> None:
        """Join the parts; nothing moves.

        Args:
            folder: Where everything is written.
            plan: The plan that the folder holds.
            players: The policies.
            judge: What the players ask for the stage.
            duo: The arms, started.
            overlay: Layouts and their images.
            server: The page, which takes its messages here from now on.
            silence_s: Seconds without a sign of the page after which the arms are held.
            wall: Date and time of day, for the log.
        """
        self._folder, self._plan, self._players = folder, plan, players
        self._judge, self._duo, self._overlay, self._server = judge, duo, overlay, server
        self._head = HeadCamera(duo)
        self._silence, self._wall = silence_s, wall
        self._log: TrialLog = folder.open_log(wall())
        self._standing = Standing.of(self._log.entries)
        self._inbox: queue.Queue[messages.Message] = queue.Queue()
        self._board = Board(plan, judge, overlay.table_from_head)
        self._over = threading.Event()
        self._heard = time.monotonic()
        self._lost = ""
        self._trial: Trial | None = None
        self._attempt = 0
        self._start = 0.0
        self._at_end: bool | None = None
        self._note = ""
        self._ghost_joints: np.ndarray | None = None
        self._begun: set[int] = set()
        self._next_image = 0.0
        self._sheets: dict[str, str] = {}
        server.on_message = self._take
        server.on_driver_lost = lambda: self._lose("The operator's page lost its connection.")

    def run(self) -> bool:
        """Play what is missing; whether nothing is missing at the end.

        Raises:
            OutputError: Something cannot be written.
        """
        try:
            for trial in self._folder.remaining(self._plan, self._standing):
                while not self._play_once(trial):
                    pass
        except Stopped:
            return False
        finally:
            self._duo.hold("The session is over.")
        self._board.phase = Phase.OVER
        self._publish()
        return True

    def stop(self) -> None:
        """Let `run` end, and hold the arms; for other threads and signal handlers."""
        self._over.set()
        self._duo.hold("The session was stopped.")

    def close(self) -> None:
        """Let go of the log; closing twice is harmless."""
        self._log.close()

    def tell(self, **more: object) -> None:
        """Show the state on the page, with what else is to be said."""
        self._board.more = more
        self._publish()

    # --- one trial -------------------------------------------------------------------------------

    def _play_once(self, trial: Trial) -> bool:
        """Play a trial once; whether it counts."""
        self._trial = trial
        self._attempt = self._standing.attempts.get(trial.number, 0) + 1
        self._at_end, self._note, self._lost, self._ghost_joints = None, "", "", None
        self._board.phase = Phase.PLACING  # no press of the trial before counts for this one
        self._judge.begin()
        layout = self._overlay.layout(
            self._plan.episode(trial.episode).seed, self._plan.episode(trial.episode).split
        )
        self._board.begin(trial, self._attempt, layout, self._standing)
        self._publish()  # before anything that takes long
        self._offer_sheet(trial, layout)
        self._write(Kind.BEGIN, text=self._plan.letter(trial.policy))
        self._place(layout)
        played, film = self._play(trial, layout)
        if (video := film.video()) is not None:
            name = f"film-{trial.number}.{self._attempt}.webm"
            self._board.film = self._server.publish_image(name, video)
        reason = self._lost or played.invalid or self._judged(played)
        if reason:
            automatic = bool(self._lost or played.invalid)
            if video is not None:
                write(self._folder.invalid_film(trial.number, self._attempt), video)
            self._players.settle(trial, counts=False)
            self._write(Kind.INVALID, text=reason, yes=automatic)
            self._board.message = f"The trial is invalid and comes again: {reason}"
            self._standing = Standing.of(self._log.entries)
            return False
        self._keep(trial, played, video)
        self._board.message = ""
        return True

    def _offer_sheet(self, trial: Trial, layout: Layout) -> None:
        """Give the footprints of an episode out as a sheet to print, for rigs without cameras."""
        name = f"sheet-{trial.episode}"
        if name not in self._sheets:
            pdf = layout_sheet(self._overlay.task, layout, f"episode {trial.episode}")
            self._sheets = {name: self._server.publish_image(f"{name}.pdf", pdf)}
        self._board.sheet = self._sheets[name]

    def _place(self, layout: Layout) -> None:
        """Wait until the objects are placed and the operator has said that the arms may move."""
        while True:
            match self._next(layout):
                case messages.Placed():
                    self._keep_image()
                    self._write(Kind.PLACED)
                    self._board.phase = Phase.READY
                case messages.PlaceAgain():
                    self._board.phase = Phase.PLACING
                case messages.Start() if self._board.phase is Phase.READY:
                    if self._confirm():
                        return
                case messages.Home():
                    self._go_home()
                case messages.Recover():
                    self._recover()
                case _:
                    pass

    def _play(self, trial: Trial, layout: Layout) -> tuple[Played, Film]:
        self._heard = time.monotonic()
        self._write(Kind.START)
        self._board.phase, self._board.message = Phase.MOVING, ""
        self._publish()
        film = Film(self._head.image, self._server.publish_frame)
        watch = Watch(self._on_start, self._on_step)
        played = self._players.play(trial, layout, [film, watch])
        self._duo.hold("The episode is over.")
        self._write(
            Kind.END,
            step=played.steps,
            time_s=round(self._time(), 3),
            text=played.machinery or played.stopped or ("" if played.error is None else "error"),
        )
        return played, film

    def _on_start(self) -> None:
        self._start = self._duo.clock.now()
        self._board.phase = Phase.PLAYING
        self._publish()

    def _on_step(self, number: int) -> None:
        """After each control step: hold where nobody is at the page, and show how it goes."""
        silent = time.monotonic() - self._heard
        if silent > self._silence:
            self._lose(f"The operator's page gave no sign for {silent:.1f} s.")
        if number % Board.EVERY == 0:
            self._publish()

    def _judged(self, played: Played) -> str:
        """Wait for the operator's judgement; why the trial does not count, empty if it does."""
        self._board.phase = Phase.JUDGING
        self._board.message = played.ending
        while True:
            match self._next(None):
                case messages.AtEnd(holds=holds):
                    self._at_end = self._board.at_end = holds
                    self._write(Kind.AT_END, yes=holds)
                case messages.Note(text=text):
                    self._note = self._board.note = text
                    self._write(Kind.NOTE, text=text)
                case messages.Invalid(reason=reason):
                    return reason
                case messages.Finish():
                    if not (played.ended_by_success and not self._judge.final_holds):
                        return ""
                    self._board.message = (
                        "The press of the last stage ended this episode, and was taken back: the "
                        "policy was cut short. Press it again, or mark the trial as invalid."
                    )
                case _:
                    pass

    def _keep(self, trial: Trial, played: Played, video: bytes | None) -> None:
        """Write the record, then say in the log that the trial counts."""
        presses = self._judge.presses
        judged = Judged(
            rater=self._plan.rater,
            presses=presses.all,
            note=self._note,
            repeated=tuple(self._standing.invalid.get(trial.number, ())),
        )
        at_end = True if self._at_end is None else self._at_end
        run_folder = self._folder.run(self._plan.letter(trial.policy))
        if not run_folder.description.exists() or trial.policy not in self._begun:
            with run_folder.writer() as journal:
                run_folder.begin(played.run)
                journal.start(self._players.command, 1)
            self._begun.add(trial.policy)
        run_folder.write(played.record(judged, presses.changes(), at_end=at_end), video)
        self._players.settle(trial, counts=True)
        self._write(Kind.VALID)
        self._standing = Standing.of(self._log.entries)

    # --- what the operator asks for --------------------------------------------------------------

    def _next(self, layout: Layout | None) -> messages.Message | None:
        """The operator's next message, or None after a turn; the page shows what is there."""
        if self._over.is_set():
            raise Stopped
        try:
            return self._inbox.get(timeout=TURN_S)
        except queue.Empty:
            pass
        clock = self._duo.clock
        clock.wait_until(clock.now() + TURN_S)
        if layout is not None:
            self._show_placing(layout)
        self._publish()
        return None

    def _confirm(self) -> bool:
        """Take the operator's word that the arms may move; whether nothing is in the way."""
        try:
            self._duo.supervisor.confirm()
        except BackendError as error:
            self._board.message = str(error)
            return False
        return True

    def _go_home(self) -> None:
        if not self._confirm():
            return
        before, self._board.phase = self._board.phase, Phase.MOVING
        self._heard = time.monotonic()
        self._publish()
        try:
            self._duo.home()
            self._board.message = "The arms are at home."
        except BackendError as error:
            self._board.message = str(error)
        self._board.phase = before

    def _recover(self) -> None:
        try:
            self._duo.supervisor.recover()
            self._board.message = "Recovered. Nothing moves before you confirm."
        except BackendError as error:
            self._board.message = str(error)

    # --- in the server's thread ------------------------------------------------------------------

    def _take(self, is_driver: bool, data: bytes) -> str | None:
        """Take a message of the page."""
        if not is_driver:
            return WATCHING
        self._heard = time.monotonic()
        message = messages.read(data)
        if isinstance(message, messages.Alive):
            return None
        if isinstance(message, messages.Hold):
            self._duo.hold(HELD_BY_OPERATOR)
            self._write(Kind.HOLD, text=HELD_BY_OPERATOR)
            return None
        phase = self._board.phase
        if not isinstance(message, _ALLOWED[phase]):
            raise MessageError(f"Not now: this is not for the state {phase.value!r}.")
        if isinstance(message, messages.Stage | messages.Undo):
            stage = message.stage if isinstance(message, messages.Stage) else None
            film_s = message.time_s if isinstance(message, messages.Stage) else None
            if film_s is not None and phase is not Phase.JUDGING:
                raise MessageError("There is no film before the trial is over.")
            time_s = self._time() if film_s is None else film_s
            self._judge.press(stage, time_s, self._note_press, is_of_film=film_s is not None)
            self._publish()
        else:
            self._inbox.put(message)
        return None

    def _note_press(self, press: Press) -> None:
        number = 0 if self._trial is None else self._trial.number
        self._log.add(press_entry(press, number, self._attempt, self._wall()))

    def _lose(self, reason: str) -> None:
        """Nobody is at the page: hold, and let the trial not count."""
        if self._board.phase in {Phase.PLAYING, Phase.MOVING} and not self._lost:
            self._lost = reason
            self._duo.hold(reason)

    # --- small things ----------------------------------------------------------------------------

    def _time(self) -> float:
        """Seconds since the episode began, on the rig's clock."""
        return max(0.0, self._duo.clock.now() - self._start)

    def _write(self, kind: Kind, **more: object) -> None:
        if self._trial is not None:
            make = partial(Entry, kind=kind, trial=self._trial.number, attempt=self._attempt)
            self._log.add(make(at=self._wall(), **more))  # pyright: ignore[reportArgumentType]

    def _keep_image(self) -> None:
        image = self._head.image(NATIVE)
        if image is not None and self._trial is not None:
            write(self._folder.placed(self._trial.number, self._attempt), jpeg(image))

    def _show_placing(self, layout: Layout) -> None:
        """Show the live image, and the layout over it; the ghost again once an arm has moved."""
        if not self._server.has_viewers or time.monotonic() < self._next_image:
            return
        self._next_image = time.monotonic() + LIVE_S
        if (image := self._head.image(NATIVE)) is not None:
            self._server.publish_frame(jpeg(image))
        joints = self._duo.read().joints
        before = self._ghost_joints
        if before is not None and np.max(np.abs(joints - before)) < MOVED_RAD:
            return
        self._ghost_joints = joints.copy()
        for name, made in self._overlay.images(layout, joints).items():
            address = self._server.publish_image(f"{name}-{self._board.next_image()}", made)
            self._board.images[name] = address

    def _publish(self) -> None:
        self._server.publish_status(self._board.status(self._duo.fault, self._duo.held))
