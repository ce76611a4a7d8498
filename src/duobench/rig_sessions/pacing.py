"""The time of a session: thirty control steps a second, or one for each message."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

import numpy as np

from duobench.rig_sessions.teleoperation import Session, State
from duobench.types import CONTROL_HZ

PERIOD_S = 1.0 / CONTROL_HZ
"""Seconds from one control step to the next."""
KEPT_TIMES = 18_000
"""Periods and latencies that are remembered: ten minutes."""
SHOWN_TIMES = 30
"""How many of the last latencies the operator is shown the middle of."""
QUANTILES = (50, 95, 99)


class Timings:
    """How long a session's steps really took, in milliseconds."""

    def __init__(self) -> None:
        """Begin without any."""
        self.periods: deque[float] = deque(maxlen=KEPT_TIMES)
        """From one step of the loop to the next."""
        self.latencies: deque[float] = deque(maxlen=KEPT_TIMES)
        """From the arrival of a sample to the end of the control step that executed it."""

    @property
    def latency_ms(self) -> float | None:
        """The middle one of the last latencies; None before the first."""
        latest = list(self.latencies)[-SHOWN_TIMES:]
        return round(float(np.median(latest)), 1) if latest else None

    def summary(self) -> dict[str, dict[str, float]]:
        """Quantiles (`p50`, `p95`, `p99`) and the largest (`max`) of `period_ms`, `latency_ms`."""
        return {
            name: {
                **{f"p{q}": float(np.percentile(times, q)) for q in QUANTILES},
                "max": max(times),
            }
            for name, times in (("period_ms", self.periods), ("latency_ms", self.latencies))
            if times
        }


def run(
    session: Session,
    on_step: Callable[[], None] = lambda: None,
    *,
    is_stopped: Callable[[], bool] = lambda: False,
    timings: Timings | None = None,
) -> Timings:
    """Run a session until it is over: in lockstep if it is, otherwise in real time.

    In real time a loop that is late goes on at once and forgets the delay: simulated time slows
    down, and no control step is left out.

    Args:
        session: The session.
        on_step: Called after each turn of the loop, to show what is; its time counts.
        is_stopped: Whether to stop before the session is over.
        timings: Where to note times; new ones if not given.

    Returns:
        The times.

    Raises:
        OutputError: An episode cannot be written.
    """
    timings = Timings() if timings is None else timings
    due = last = time.monotonic()
    newest = session.device.sampled_s
    while session.state is not State.OVER and not is_stopped():
        if session.lockstep:
            session.wait(PERIOD_S)
        has_stepped = session.advance(time.monotonic())
        now, sampled = time.monotonic(), session.device.sampled_s
        if has_stepped and sampled is not None and sampled != newest:
            timings.latencies.append(1000.0 * (now - sampled))
        newest = sampled
        on_step()
        if not session.lockstep:
            due = max(due + PERIOD_S, time.monotonic())
            time.sleep(due - time.monotonic() if due > time.monotonic() else 0.0)
        now, before = time.monotonic(), last
        last = now
        if has_stepped:
            timings.periods.append(1000.0 * (now - before))
    return timings
