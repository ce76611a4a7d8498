"""A person at a rig: place the objects, confirm, let it run, decide; one episode after the other.

The arms are led in the thread that calls `run`. What the operator says arrives in another one:
stages are judged and a hold holds there at once; all else waits until `run` asks for it. What the
operator sees is a view: a page, or a terminal. A person who leads the arms, simulated or real, has
the states of `teleop.teleoperation` instead.
"""

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from enum import StrEnum
from functools import partial
from typing import Any, Protocol

import gymnasium as gym

from duobench.core.errors import BackendError, MessageError
from duobench.evaluation.rollouts import (
    Info,
    Observation,
    Step,
    Watcher,
)
from duobench.policy.interruptible import InterruptiblePolicy
from duobench.real.duo import FrankaDuo
from duobench.real.judge import HumanJudge
from duobench.real.sessions import messages
from duobench.real.sessions.policy_runner import PlayedEpisode, PolicyRunner
from duobench.real.sessions.preparing import (
    HOME,
    HOME_BUTTON,
    PLACED_BUTTON,
    READY,
    STEPS,
    TO_HOME,
    clear,
    find_hindrance,
)
from duobench.real.sessions.trials_folder import LogKind
from duobench.results.labels import StageLabel
from duobench.teleop.panel import Button, Panel

HELD_BY_OPERATOR = "The operator held the arms."
CONNECTION_LOST = "The operator's page lost its connection."
TAKEN_OVER = "Another visitor took over the page."
STOPPED = "The session was stopped."
CUT_SHORT = (
    "The press of the last stage ended this episode, and was taken back: the policy was cut short. "
    "Press it again, or mark the trial as invalid."
)
NOT_BEGUN = (
    "Nothing was played, and nothing counts. Start again once it is set right: {}"
)
NEVER_COUNTS = "This cannot count: say why the arms stopped."


class Phase(StrEnum):
    """Phase of a session."""

    PLACING = "placing"
    """The operator puts the objects where the layout says."""
    READY = "ready"
    """The objects lie there; the operator may start the policy."""
    MOVING = "moving"
    """The arms go home, or the fingers move at the operator's word."""
    PLAYING = "playing"
    """The policy plays."""
    JUDGING = "judging"
    """The episode is over; the operator judges it."""
    OVER = "over"
    """All episodes are played."""


PLAYED, JUDGED = "Start", "Judged?"
"""Last steps of an episode that a policy plays."""
_TITLES = {
    Phase.PLACING: "Place the objects",
    Phase.READY: "Ready",
    Phase.MOVING: "The arms move",
    Phase.PLAYING: "The policy plays",
    Phase.JUDGING: "Judge the trial",
    Phase.OVER: "All trials are played",
}
_TODOS = {
    Phase.PLACING: "Put each object where its outline is, then press Placed.",
    Phase.READY: "Step back. The arms move once you start the policy.",
    Phase.MOVING: "Home, slowly, or their fingers. Stay away from them.",
    Phase.PLAYING: "Press the number of each stage when it is reached.",
    Phase.JUDGING: "The arms are held. Correct what is wrong, then close the trial.",
    Phase.OVER: "",
}
_AGAIN = Button(
    id="place_again",
    words="Place again",
    message=messages.PlaceAgain(),
)
_START = Button(
    id="start",
    words="Nobody is near: start",
    message=messages.Start(),
)
_GIVE_UP = Button(
    id="give_up",
    words="The policy does not answer: give it up",
    message=messages.GiveUp(),
)
_LABELS = (messages.Stage, messages.Undo)
_PLACING = (messages.Home, messages.Activate, messages.Open, messages.Recover)
_ALLOWED: dict[Phase, tuple[type, ...]] = {
    Phase.PLACING: (messages.Placed, *_PLACING),
    Phase.READY: (messages.PlaceAgain, messages.Start, *_PLACING),
    Phase.MOVING: (messages.GiveUp,),
    Phase.PLAYING: (*_LABELS, messages.GiveUp),
    Phase.JUDGING: (
        *_LABELS,
        messages.AtEnd,
        messages.Note,
        messages.Finish,
        messages.Invalid,
    ),
    Phase.OVER: (),
}
"""Messages that each phase takes, beside a hold."""


class Stopped(Exception):  # noqa: N818 - no error: a person ended the session
    """The session was stopped."""


class SessionView(Protocol):
    """View of the operator: shows the session and gives messages."""

    def publish(self) -> None:
        """Show the session as it is now."""

    def next(self) -> messages.Message | None:
        """Return the next message that `take` left to do; None after a while without one."""

    def moving(self) -> AbstractContextManager[object]:
        """Surrounds what moves the arms: what the operator says counts at once."""
        ...


class RigSession:
    """Leads an operator through episodes; subclasses decide what becomes of them."""

    view: SessionView

    def __init__(self, duo: FrankaDuo, judge: HumanJudge) -> None:
        self.duo, self.judge = duo, judge
        self.phase = Phase.PLACING
        self.message = ""
        """Sentence for the operator."""
        self.note = ""
        """The operator's remark about the episode."""
        self.at_end: bool | None = None
        """Whether the last stage still held at the end; None if it was not judged."""
        self.lost = ""
        """Reason why the operator was absent while arms might move; empty if present."""
        self.is_home = False
        """Whether the operator has sent the arms home for this episode."""
        self.reasons: tuple[str, ...] = ()
        """Reasons to choose from where the arms stopped and the episode cannot count."""
        self.waits = False
        """Whether the policy has not answered for long, so that it may be given up."""
        self._moves = 0  # index of the step at which arms or fingers move
        self._asked: InterruptiblePolicy | None = None  # in the episode that is played
        self._over = threading.Event()

    # --- from any thread -------------------------------------------------------------------------

    @property
    def panel(self) -> Panel:
        """Steps of an episode, and what may be pressed now."""
        now, todo, buttons = self._step()
        if self.waits:
            buttons = (*buttons, _GIVE_UP)
        return Panel(
            steps=(*STEPS, PLAYED, JUDGED),
            now=now,
            title=_TITLES[self.phase],
            todo=todo,
            buttons=buttons,
            can_hold=self.phase in {Phase.MOVING, Phase.PLAYING},
        )

    def _step(self) -> tuple[int, str, tuple[Button, ...]]:
        """Index of the present step, what is to be done, and its buttons."""
        todo, start = _TODOS[self.phase], len(STEPS)
        match self.phase:
            case Phase.PLACING | Phase.READY:
                return self._step_before()
            case Phase.MOVING:
                return self._moves, todo, ()
            case Phase.PLAYING:
                return start, todo, ()
            case Phase.JUDGING:
                return start + 1, todo, ()
            case Phase.OVER:
                return start + 2, todo, ()

    def _step_before(self) -> tuple[int, str, tuple[Button, ...]]:
        is_ready = self.phase is Phase.READY
        hindrance = find_hindrance(self.duo)
        if hindrance is not None:
            why_not = hindrance.why_not
            home, start = (
                replace(each, why_not=why_not) for each in (HOME_BUTTON, _START)
            )
            then = _AGAIN if is_ready else PLACED_BUTTON
            return 0, hindrance.todo, (*hindrance.buttons, home, then, start)
        if is_ready:
            buttons = (replace(_START, is_next=True), _AGAIN, HOME_BUTTON)
            return len(STEPS), _TODOS[self.phase], buttons
        home = replace(HOME_BUTTON, is_next=not self.is_home)
        placed = replace(PLACED_BUTTON, is_next=self.is_home)
        if self.is_home:
            return 2, _TODOS[self.phase], (placed, home)
        return 1, TO_HOME, (home, placed)

    @property
    def is_stopped(self) -> bool:
        """Whether `run` is to end."""
        return self._over.is_set()

    def stop(self) -> None:
        """Let `run` end, and hold the arms; for signal handlers too."""
        self._over.set()
        self.duo.hold(STOPPED)

    def give_up(self) -> bool:
        """Let the policy fail that is waited for; False if none is."""
        return self._asked is not None and self._asked.give_up()

    def lose(self, reason: str) -> None:
        """Hold the arms where the operator is lost; an episode that is not over does not count."""
        self.duo.supervisor.revoke()  # nothing that was pressed before shall move them
        if self._may_move and not self.lost:
            self.lost = reason
            self.duo.hold(reason)

    @property
    def _may_move(self) -> bool:
        return self.phase in {Phase.PLAYING, Phase.MOVING} and not self.judge.is_over

    def take(self, message: messages.Message) -> bool:
        """Do at once what cannot wait: a hold, and the word that a stage is reached.

        Returns:
            Whether the message was one of these, so that nothing else is to be done.
        """
        if isinstance(message, messages.Hold):
            self.duo.hold(HELD_BY_OPERATOR)
            self.write(LogKind.HOLD, text=HELD_BY_OPERATOR)
            return True
        if not isinstance(message, _ALLOWED[self.phase]):
            raise MessageError(
                f"Not now: this is not for the state {self.phase.value!r}."
            )
        if isinstance(message, messages.GiveUp):
            if not self.give_up():
                raise MessageError(
                    "The policy is not waited for: there is nothing to give up."
                )
            return True
        if isinstance(message, (messages.Home, messages.Start)):
            # From now on, so that a hold that is pressed later takes it back, though this waits.
            with suppress(BackendError):  # it is said once it is tried
                self.duo.supervisor.confirm()
        if not isinstance(message, _LABELS):
            return False
        stage, film_s = None, None
        if isinstance(message, messages.Stage):
            stage, film_s = message.stage, message.time_s
        if film_s is not None and self.phase is not Phase.JUDGING:
            raise MessageError("There is no film before the episode is over.")
        self.judge.declare(stage, film_s, self._write_label)
        return True

    def write(self, kind: LogKind, **more: Any) -> None:
        """Log an event before its effect is shown; see `LogEntry`."""

    def _write_label(self, label: StageLabel) -> None:
        about = {"stage": label.stage, "step": label.step, "time_s": label.time_s}
        self.write(LogKind.PRESS, **about, yes=label.late or None)

    # --- one episode, in the session's own thread ------------------------------------------------

    def begin(self) -> None:
        """Begin another episode: no press of the one before counts for it."""
        self.phase = Phase.PLACING
        self.note = ""
        self.at_end = None
        self.lost = ""
        self.is_home = False
        self.reasons = ()
        self.judge.begin()

    def place(self) -> None:
        """Wait until the objects are placed and the operator has said that the arms may move."""
        while True:
            match self.view.next():
                case messages.Placed() if self._try(self.keep_placed):
                    self.write(LogKind.PLACED)
                    self.phase = Phase.READY
                case messages.PlaceAgain():
                    self.phase = Phase.PLACING
                case messages.Start() if self.phase is Phase.READY:
                    if self._try(self._check_start):
                        return
                case messages.Recover():
                    self.is_home = False
                    if self._try(self.duo.supervisor.recover):
                        self.message = "Recovered. Nothing moves before you confirm."
                case other:
                    self._handle(other)

    def keep_placed(self) -> None:
        """Take the operator's word that the objects are placed; in a rehearsal, place them.

        Raises:
            BackendError: The objects cannot be placed like this.
        """

    def play(
        self,
        runner: PolicyRunner,
        seed: int,
        options: dict[str, Any],
        *watchers: Watcher,
    ) -> PlayedEpisode:
        """Let a policy play; the arms are held afterwards.

        One that did not come to its first command leaves the session ready to start again.
        """
        self.write(LogKind.START)
        self.phase, self._moves = Phase.MOVING, len(STEPS)
        self.message = ""
        self.lost = ""
        self.view.publish()
        self._asked, runner.asked.on_wait = runner.asked, self._wait
        with self.view.moving():
            played = runner.play(seed, options, [self, *watchers])
        self._asked, self.waits = None, False
        fault = self.duo.fault
        if played.failure is not None and fault is not None:
            played = replace(played, fault=fault.kind)
        if not played.has_begun:
            self._wait_again(self.lost or played.stopped or str(played.failure))
            return played
        failure = "" if played.failure is None else played.invalid
        self.write(
            LogKind.END,
            step=played.steps,
            time_s=round(self.judge.time_s, 3) if played.steps else None,
            text=failure or played.stopped or ("" if played.error is None else "error"),
            fault=played.fault,
        )
        return played

    def _wait_again(self, reason: str) -> None:
        """Go back to where the operator starts the policy: nothing of it was played."""
        self.write(LogKind.NOT_BEGUN, text=reason)
        self.judge.begin()
        self.phase, self.lost, self.is_home = Phase.READY, "", False
        self.message = NOT_BEGUN.format(reason)

    def _wait(self) -> None:
        if self.is_stopped:
            self.give_up()
        self.waits = True
        self.view.publish()

    def on_episode_start(
        self,
        env: gym.Env,  # noqa: ARG002 - the protocol's signature
        observation: Observation,  # noqa: ARG002 - the protocol's signature
        info: Info,  # noqa: ARG002
    ) -> None:
        """Show that the policy begins; the arms are at home."""
        self.phase = Phase.PLAYING
        self.waits = False
        self.view.publish()

    def on_step(self, step: Step) -> None:  # noqa: ARG002 - the protocol's signature
        """A control step is over."""
        self.waits = False

    def on_episode_end(self, error: BaseException | None) -> None:  # noqa: ARG002 - the protocol's signature
        """The policy plays no more: the arms are held, and what is pressed now may be late."""
        self.judge.end()
        self.duo.hold("The episode is over.")

    def decide(self, played: PlayedEpisode, message: str) -> str:
        """Wait for the operator's word; why the episode does not count, empty if it does.

        The message is for the operator, and says how the episode ended.
        """
        self.phase = Phase.JUDGING
        self.message = message
        self.reasons = played.reasons
        while True:
            match self.view.next():
                case messages.AtEnd(holds=holds):
                    self.at_end = holds
                    self.write(LogKind.AT_END, yes=holds)
                case messages.Note(text=text):
                    self.note = text
                    self.write(LogKind.NOTE, text=text)
                case messages.Invalid(reason=reason):
                    self.phase = Phase.MOVING  # no press counts any more
                    return reason
                case messages.Finish():
                    objection = self.objection(played)
                    if not objection:
                        self.phase = Phase.MOVING
                        return ""
                    self.message = objection
                case _:
                    pass

    def objection(self, played: PlayedEpisode) -> str:
        """Reason why an episode cannot count as judged, for the operator; empty if it can."""
        if played.reasons:
            return NEVER_COUNTS
        is_solved = self.judge.labels.stage == self.judge.max_stage
        return CUT_SHORT if played.ended_by_success and not is_solved else ""

    def _handle(self, message: messages.Message | None) -> None:
        """Move arms or fingers as a message asks while objects are placed."""
        match message:
            case messages.Home(with_object=with_object):
                self._go_home(with_object)
            case messages.Activate():
                self._move(
                    partial(clear, self.duo, message), "The grippers are active."
                )
            case messages.Open():
                self._move(partial(clear, self.duo, message), "Opened.")
            case _:
                pass

    def _check_start(self) -> None:
        self.duo.hands.check_active()
        self.duo.hands.check_free()
        self.duo.supervisor.check_confirmed()

    def _go_home(self, with_object: bool) -> None:
        def home() -> None:
            self.duo.home(with_object=with_object)
            self.duo.supervisor.revoke()  # people's hands are among the objects now

        self.is_home = self._move(home, "The arms are at home.", HOME)

    def _move(
        self,
        act: Callable[[], None],
        done: str,
        step: str = READY,
    ) -> bool:
        """Move arms or fingers while objects are placed; return whether it was done."""
        before, self.phase = self.phase, Phase.MOVING
        self._moves = STEPS.index(step)
        self.view.publish()
        with self.view.moving():
            is_done = self._try(act)
        if is_done:
            self.message = done
        self.phase, self.lost = before, ""
        return is_done

    def _try(self, act: Callable[[], None]) -> bool:
        """Do something with the arms; what hinders it is said to the operator."""
        try:
            act()
        except BackendError as error:
            self.duo.supervisor.revoke()
            self.message = str(error)
            return False
        return True
