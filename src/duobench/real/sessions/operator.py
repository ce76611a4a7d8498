"""Operator at a terminal: messages, questions, and keys that act at once."""

from collections.abc import (
    Callable,
    Iterator,
    Mapping,
    Sequence,
)
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from typing import Protocol

from duobench.core.errors import DuoBenchError
from duobench.real.duo import FrankaDuo
from duobench.real.sessions import messages
from duobench.real.sessions.preparing import (
    CARRY,
    HOME_BUTTON,
    PLACED_BUTTON,
    TO_HOME,
    TO_PLACE,
    clear,
    find_hindrance,
)
from duobench.real.sessions.session import (
    HELD_BY_OPERATOR,
    Phase,
    RigSession,
    Stopped,
)
from duobench.teleop.panel import Button

QUIT = "q"
"""Key that ends a session."""
OPERATOR_LOST = "The operator's terminal is gone."
PLAYING = "It plays. 1 to {last}: this stage is reached; s: solved; u: undo; space: hold both arms."
WAITING = "The policy does not answer. g: give it up."
DECIDE = "{} k: keep it; d: discard it; q: end, and leave it undecided."
ASK_WHY = (
    "{}\nIt is discarded. Why did the arms stop?\n{}\nq: end, and leave it undecided."
)


KeyCall = Callable[[str], object]
"""Callable that receives a key."""


class Operator(Protocol):
    """A person beside the arms, or a program in that place."""

    def say(self, text: str) -> None:
        """Show some lines."""

    def ask(self, text: str, keys: str) -> str:
        """Ask for one of some keys, and wait for it; `QUIT` once the operator is gone."""
        ...

    def listen(self, call: KeyCall | None) -> KeyCall | None:
        """Give every key to a call at once, from any thread; None ends it.

        An operator who has gone gives an empty text.

        Returns:
            The call that received keys until now.
        """
        ...


@contextmanager
def listening(operator: Operator, call: KeyCall) -> Iterator[None]:
    """Give keys to a call in the block, and afterwards to the previous one again."""
    before = operator.listen(call)
    try:
        yield
    finally:
        operator.listen(before)


def ask_to_make_ready(duo: FrankaDuo, operator: Operator) -> bool:
    """Let the operator clear the way home; False if the operator ends the session instead.

    In the way are a fault, a gripper that is not active, and what the hands hold: the operator
    presses a key for each. While fingers move, the space bar stops them.
    """
    while (hindrance := find_hindrance(duo)) is not None:
        # Objects are taken first.
        buttons = {each.key: each for each in hindrance.buttons if each.id != CARRY}
        key = operator.ask(asking(hindrance.todo, buttons), f"{''.join(buttons)}{QUIT}")
        if key == QUIT:
            return False
        try:
            with listening(operator, partial(hold_by_key, duo)):
                clear(duo, buttons[key].message)
        except DuoBenchError as error:  # it is asked again, with what is still wrong
            operator.say(str(error))
    return True


def asking(todo: str, buttons: Mapping[str, Button]) -> str:
    """Question at a terminal: what is to be done, and the keys of the buttons."""
    keys = [f"{key}: {each.words}" for key, each in buttons.items()]
    return f"{todo}\n{'; '.join(keys)}; {QUIT}: end."


def hold_by_key(duo: FrankaDuo, key: str) -> bool:
    """Hold both arms if a key says so or the operator is gone; return whether it did."""
    if key not in {"", " "}:
        return False
    duo.hold(HELD_BY_OPERATOR if key else OPERATOR_LOST)
    return True


class TerminalView:
    """The view of a session at a terminal: it asks for one key after the other."""

    def __init__(self, session: RigSession, operator: Operator) -> None:
        self._session, self._operator = session, operator
        self.placing = ""
        """Places of the objects, in words."""

    def publish(self) -> None:
        """Say what the operator has to know while the arms move."""
        if self._session.waits:
            self._operator.say(WAITING)
        elif self._session.phase is Phase.PLAYING:
            self._operator.say(PLAYING.format(last=self._session.judge.max_stage))

    def next(self) -> messages.Message:
        """Ask the operator for the next thing to do, and return it as a message."""
        session = self._session
        if session.is_stopped:
            raise Stopped
        said, session.message = session.message, ""
        if session.phase is Phase.JUDGING and session.reasons:
            return messages.Invalid(self._why(said, session.reasons))
        if session.phase is Phase.JUDGING:
            is_kept = self._ask(DECIDE.format(said), "kd") == "k"
            return messages.Finish() if is_kept else messages.Invalid("Discarded.")
        if said:
            self._operator.say(said)
        if session.duo.supervisor.fault is not None:
            session.is_home = False
        if not session.is_home:
            if not ask_to_make_ready(session.duo, self._operator):
                raise Stopped
            if session.phase is Phase.READY:
                return messages.PlaceAgain()
            self._press(TO_HOME, HOME_BUTTON)
            return self._confirmed(messages.Home())
        if session.phase is Phase.PLACING:
            self._press(f"{self.placing}\n{TO_PLACE}", PLACED_BUTTON)
            return messages.Placed()
        return self._confirmed(messages.Start())

    def moving(self) -> AbstractContextManager[None]:
        """Keys count at once."""
        return listening(self._operator, self._take)

    def _press(
        self,
        todo: str,
        button: Button,
    ) -> None:
        """Wait until the operator presses a button."""
        self._ask(asking(todo, {button.key: button}), button.key)

    def _confirmed(self, message: messages.Message) -> messages.Message:
        """A message that has the operator's word with it."""
        self._session.take(message)
        return message

    def _why(self, said: str, reasons: Sequence[str]) -> str:
        """Ask the operator why the arms stopped."""
        choices = {str(number): reason for number, reason in enumerate(reasons, 1)}
        lines = "\n".join(f"{key}: {reason}" for key, reason in choices.items())
        return choices[self._ask(ASK_WHY.format(said, lines), "".join(choices))]

    def _ask(self, text: str, keys: str) -> str:
        key = self._operator.ask(text, f"{keys}{QUIT}")
        if key == QUIT:
            raise Stopped
        return key

    def _take(self, key: str) -> None:
        session = self._session
        if hold_by_key(session.duo, key):
            return
        if key == "g":
            session.give_up()
        elif session.phase is Phase.PLAYING:
            stage = {"u": None, "s": session.judge.max_stage}.get(key, key)
            with suppress(DuoBenchError, ValueError):  # other keys say nothing
                session.judge.declare(None if stage is None else int(stage))
