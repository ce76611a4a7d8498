"""Rig that a command line names, and the operator's terminal."""

from __future__ import annotations

import os
import queue
import re
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import say
from duobench.cli.shared.process import AT_LEAVING, stopping
from duobench.real.catalog import REHEARSAL
from duobench.real.clock import VirtualClock
from duobench.real.duo import FrankaDuo
from duobench.real.opening import open_rig, rehearsal_rig
from duobench.real.rig import Rig


def rig_file(path: str | Path, also: str = "") -> Path:
    """Existing file of a rig."""
    if not Path(path).is_file():
        raise AdvisedError(f"There is no file {path}. --rig takes a rig.json{also}.")
    return Path(path)


def known_rig(name: str) -> Rig:
    """The rig without hardware, or that of a file."""
    if name == REHEARSAL:
        return rehearsal_rig()
    return Rig.read(rig_file(name, f", or {REHEARSAL}"))


_SEQUENCE = re.compile(r"\x1b(?:\[[0-?]*[@-~]|O?[!-~])?")
"""Sequence of a key that is no character, such as Delete, which has a 3 in it."""
_CUT = re.compile(r"\x1b(?:O|\[[0-?]*)?\Z")
"""Such a sequence of which the rest is still on its way."""
_REST_S = 0.1
"""How long a slow line may take for the rest; Escape itself means nothing here."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RigOptions:
    """The rig, and how it is driven."""

    rig: str
    """File of the rig, rig.json; or rehearsal, a rig without hardware, whose arms act on a
    simulation of the task."""
    guard: bool = True
    """Keep the arms apart and off the table by a simulation of them."""
    fast: bool = False
    """Do not wait for real time; for rigs without hardware alone."""

    def open(self) -> FrankaDuo:
        """The rig, not connected yet."""
        rig = known_rig(self.rig)
        if self.fast and not rig.is_computed:
            raise AdvisedError("Hardware has a clock of its own: leave out --fast.")
        return open_rig(rig, VirtualClock() if self.fast else None, guard=self.guard)


def hold_and_say(duo: FrankaDuo) -> None:
    """Hold the arms at Ctrl-C, where an operator is asked for keys."""
    from duobench.real.sessions.session import HELD_BY_OPERATOR

    duo.hold(HELD_BY_OPERATOR)
    with suppress(OSError):  # the terminal may be gone
        os.write(
            sys.stderr.fileno(),
            b"\nThe arms are held. q ends; Ctrl-C again leaves at once.\n",
        )


def activate_grippers(duo: FrankaDuo) -> None:
    """Activate grippers that are not active or well, once the operator has said so."""
    asleep = duo.hands.to_activate
    if asleep:
        which = " and ".join(asleep)
        confirm(
            f"To be activated: {which}. Is nothing between the fingers? They move.",
            "activate",
        )
        with stopping(lambda: duo.hold("Ctrl-C.")):
            duo.hands.activate()


def confirm(question: str, word: str) -> None:
    """Go on only if the operator types a word."""
    say(f"{question}\nType {word} and Enter; anything else ends this.")
    if sys.stdin.readline().strip() != word:
        raise AdvisedError("Nothing was moved.")


class KeyTerminal:
    """Reads keys in a thread of its own, as `operator.Operator` asks for them.

    Args:
        handle: What keys are read from; standard input where nothing is given. A terminal is
            restored at the end.
    """

    def __init__(self, handle: int | None = None) -> None:
        self._handle = sys.stdin.fileno() if handle is None else handle
        self.on_answer: Callable[[], object] = lambda: None
        """Called when a question is answered."""
        self._keys: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._call: Callable[[str], object] | None = None
        self._before: list[Any] | None = None
        if os.isatty(self._handle):
            self._before = termios.tcgetattr(self._handle)
            AT_LEAVING.append(self.close)
            tty.setcbreak(self._handle)
        threading.Thread(target=self._read, name="keys", daemon=True).start()

    def say(self, text: str) -> None:
        """Print some lines."""
        sys.stdout.write(text + "\n")
        sys.stdout.flush()

    def ask(self, text: str, keys: str) -> str:
        """Ask for a key, and wait for it; keys that were pressed before do not count."""
        from duobench.real.sessions.operator import QUIT

        while not self._keys.empty():
            if not self._keys.get():
                self._keys.put("")
                return QUIT
        self.say(text)
        while True:
            key = self._keys.get()
            if not key:
                self._keys.put("")  # and for later questions
                return QUIT
            if key in keys:
                self.on_answer()
                return key

    def listen(
        self, call: Callable[[str], object] | None
    ) -> Callable[[str], object] | None:
        """Give every key to a call at once, during questions too; return the previous call."""
        before, self._call = self._call, call
        return before

    def leave(self) -> None:
        """Say that the session ends, during questions too; for signal handlers."""
        with suppress(OSError):  # the terminal may be gone
            os.write(sys.stderr.fileno(), b"\nThe arms are held; the session ends.\n")
        self._keys.put("")

    def close(self) -> None:
        """Restore the terminal."""
        before, self._before = self._before, None
        if before is not None:
            AT_LEAVING.remove(self.close)
            with suppress(termios.error):  # the terminal may be gone
                termios.tcsetattr(self._handle, termios.TCSADRAIN, before)

    def _read(self) -> None:
        cut = ""  # waits for its rest; nothing else does: the key before it may hold the arms
        while True:
            try:
                if cut and not select.select([self._handle], [], [], _REST_S)[0]:
                    cut = ""
                said = os.read(self._handle, 1024).decode(errors="replace")
            except OSError:
                said = ""
            keys = cut + said
            cut = found[0] if (found := _CUT.search(keys)) else ""
            for key in _SEQUENCE.sub("", keys.removesuffix(cut)) if said else [""]:
                call = self._call
                if call is not None:
                    call(key)
                self._keys.put(key)
            if not said:
                return
