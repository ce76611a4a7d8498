"""Time as devices see it: real, or virtual, which passes only while a thread waits.

Everything periodic on real arms (followers, cameras, gripper reads) is a call that a clock makes.
On a real clock each has a thread of its own; on a virtual one they take turns in the order of their
times, so that what simulated devices do is the same on every machine.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Protocol

PACE_S = 0.002
"""Seconds from one turn of paced time to the next."""
LONGEST_PACE_S = 0.02
"""Longest time in seconds that passes in one turn; what a computer takes longer is left out."""


class Ticker(Protocol):
    """A call that is made periodically until it is stopped."""

    def stop(self) -> None:
        """Make no more calls; a running one ends first. Stopping twice is harmless."""


class Clock(Protocol):
    """Seconds that never go back, and who is called when."""

    def now(self) -> float:
        """Seconds since a moment that stays the same while the process lives."""
        ...

    def wait_until(self, time_s: float) -> None:
        """Return at a time, or at once if it has passed."""

    def every(
        self,
        period_s: float,
        call: Callable[[], None],
        name: str,
    ) -> Ticker:
        """Make a call periodically, the first time one period from now.

        Args:
            period_s: Seconds from one call to the next; calls that come late are not made up for.
            call: Function to call. An error in it ends its thread, or is raised in the thread that
                waits on a virtual clock: a call that can fail keeps its error to be read later.
            name: Name of its thread.
        """
        ...


class SystemClock:
    """The machine's own monotonic clock; each periodic call has a thread of its own."""

    def now(self) -> float:
        """Seconds of `time.monotonic`."""
        return time.monotonic()

    def wait_until(self, time_s: float) -> None:
        """Sleep until a time."""
        left = time_s - time.monotonic()
        if left > 0.0:
            time.sleep(left)

    def every(
        self,
        period_s: float,
        call: Callable[[], None],
        name: str,
    ) -> Ticker:
        """Make a call periodically, in a thread."""
        return _Thread(period_s, call, name)


class _Thread:
    """A thread that makes one call on a fixed grid of times."""

    def __init__(
        self,
        period_s: float,
        call: Callable[[], None],
        name: str,
    ) -> None:
        self._period, self._call = period_s, call
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        due = time.monotonic() + self._period
        while not self._is_over.wait(max(0.0, due - time.monotonic())):
            self._call()
            due = max(due + self._period, time.monotonic())

    def stop(self) -> None:
        self._is_over.set()
        if threading.current_thread() is not self._thread:
            self._thread.join()


class VirtualClock:
    """Time that passes only in `wait_until`, with every periodic call made on the way, in order."""

    def __init__(self) -> None:
        self._now = 0.0
        self._tickers: list[_Virtual] = []

    def now(self) -> float:
        """Seconds that were waited for so far."""
        return self._now

    def wait_until(self, time_s: float) -> None:
        """Let time pass: make all calls that are due until then, in the order of their times."""
        while tickers := tuple(self._tickers):
            first = min(tickers, key=lambda ticker: ticker.due)  # the older one of two
            if first.due > time_s:
                break
            self._now = max(self._now, first.due)
            first.run()
        self._now = max(self._now, time_s)

    def every(
        self,
        period_s: float,
        call: Callable[[], None],
        name: str,  # noqa: ARG002 - the protocol's signature
    ) -> Ticker:
        """Make a call periodically while a thread waits."""
        ticker = _Virtual(self._tickers, self._now, period_s, call)
        self._tickers.append(ticker)
        return ticker


class PacedClock(VirtualClock):
    """Time of rigs without hardware for people: as fast as real time, and never faster.

    One thread makes all periodic calls, in the order of their times. Where a computer cannot keep
    up, time passes more slowly for everybody, so that no device seems to stand still.
    """

    def __init__(self) -> None:
        super().__init__()
        self._passed = threading.Condition()
        self._thread: threading.Thread | None = None  # while there are calls to be made
        self._error: Exception | None = None

    def wait_until(self, time_s: float) -> None:
        """Wait until time has passed; a periodic call that waits lets it pass itself."""
        if threading.current_thread() is self._thread:
            super().wait_until(time_s)
            return
        with self._passed:
            self._passed.wait_for(lambda: self._now >= time_s or self._thread is None)
        if self._error is not None:
            raise self._error
        left = time_s - self._now
        if left > 0.0:
            time.sleep(left)
            super().wait_until(time_s)

    def every(
        self,
        period_s: float,
        call: Callable[[], None],
        name: str,
    ) -> Ticker:
        """Make a call periodically, in the thread of all of them."""
        with self._passed:
            ticker = super().every(period_s, call, name)
            if self._thread is None and self._error is None:
                self._thread = threading.Thread(
                    target=self._run, name="time", daemon=True
                )
                self._thread.start()
        return ticker

    def _run(self) -> None:
        last = time.monotonic()
        while True:
            with self._passed:
                self._passed.notify_all()
                if not self._tickers or self._error is not None:
                    self._thread = None
                    return
            time.sleep(PACE_S)
            before, last = last, time.monotonic()
            try:
                super().wait_until(self._now + min(last - before, LONGEST_PACE_S))
            except Exception as error:  # noqa: BLE001 - raised in the thread that waits
                self._error = error


@dataclass(eq=False)
class _Virtual:
    """A periodic call on a virtual clock, in its list of them."""

    tickers: list[_Virtual]
    start: float
    period_s: float
    call: Callable[[], None]
    calls: int = 0
    running: threading.RLock = field(default_factory=threading.RLock)
    is_over: bool = False

    @property
    def due(self) -> float:
        return (
            self.start + (self.calls + 1) * self.period_s
        )  # so that no rounding adds up

    def run(self) -> None:
        with self.running:
            self.calls += 1
            if not self.is_over:
                self.call()

    def stop(self) -> None:
        self.is_over = True
        with suppress(ValueError):  # it was stopped before
            self.tickers.remove(self)
        with self.running:  # a running call ends first
            pass
