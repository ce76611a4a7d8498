"""Pseudo-terminals: serial ports whose device is a thread of the test."""

import os
import pty
import select
import threading
import tty


class PseudoTerminal:
    """A serial port, and the other end of its cable."""

    def __init__(self) -> None:
        self.master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._is_open = True

    def read(self, wait_s: float = 0.02) -> bytes:
        """What arrived at the device, or nothing after a while."""
        return (
            os.read(self.master, 4096) if select.select([self.master], [], [], wait_s)[0] else b""
        )

    def write(self, data: bytes) -> None:
        os.write(self.master, data)

    def close(self) -> None:
        """Whoever has opened the port finds it gone; closing twice is harmless."""
        if self._is_open:
            self._is_open = False
            os.close(self.master)
            os.close(self._slave)


class Cable:
    """Two ports of which each reads what is written into the other."""

    def __init__(self) -> None:
        self._ends = PseudoTerminal(), PseudoTerminal()
        self.ours, self.theirs = (end.port for end in self._ends)
        self.is_silent = False
        """Whether what is sent is lost on the way."""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def pull(self) -> None:
        """Take our port away, as a USB plug does."""
        self._stop.set()
        self._thread.join()
        self._ends[0].close()

    def close(self) -> None:
        self.pull()
        self._ends[1].close()

    def _run(self) -> None:
        masters = [end.master for end in self._ends]
        while not self._stop.is_set():
            for ready in select.select(masters, [], [], 0.02)[0]:
                data = os.read(ready, 4096)
                if not self.is_silent:
                    os.write(masters[1 - masters.index(ready)], data)
