"""The operator's terminal: single keys, without Enter, from a terminal or from a pipe."""

from __future__ import annotations

import os
import queue
import sys
import termios
import threading
import tty
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from duobench.rig_sessions.operator import QUIT


class KeyTerminal:
    """Reads keys in a thread of its own, as `operator.Operator` asks for them.

    Args:
        handle: What keys are read from; standard input where nothing is given. A terminal is
            restored at the end.
    """

    def __init__(self, handle: int | None = None) -> None:
        self._handle = sys.stdin.fileno() if handle is None else handle
        self._keys: queue.Queue[str] = queue.Queue()
        self._call: Callable[[str], None] | None = None
        self._before: list[Any] | None = None
        if os.isatty(self._handle):
            self._before = termios.tcgetattr(self._handle)
            tty.setcbreak(self._handle)
        threading.Thread(target=self._read, name="keys", daemon=True).start()

    def say(self, text: str) -> None:
        """Print some lines."""
        sys.stdout.write(text + "\n")
        sys.stdout.flush()

    def ask(self, text: str, keys: str) -> str:
        """Ask for a key, and wait for it; keys that were pressed before do not count."""
        while not self._keys.empty():
            if not self._keys.get():
                self._keys.put("")
                return QUIT
        self.say(text)
        while True:
            key = self._keys.get()
            if not key:
                self._keys.put("")  # and for whatever is asked later
                return QUIT
            if key in keys:
                return key

    def listen(self, call: Callable[[str], None] | None) -> None:
        """Have every key given to a call at once, whatever is asked."""
        self._call = call

    def close(self) -> None:
        """Restore the terminal."""
        before, self._before = self._before, None
        if before is not None:
            termios.tcsetattr(self._handle, termios.TCSADRAIN, before)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _read(self) -> None:
        while True:
            try:
                key = os.read(self._handle, 1).decode(errors="replace")
            except OSError:
                key = ""
            if (call := self._call) is not None:
                call(key)
            self._keys.put(key)
            if not key:
                return
