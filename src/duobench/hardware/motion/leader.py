"""Who tells one arm where to be, five hundred times a second: a follower on a clock."""

from __future__ import annotations

import threading

from duobench.errors import DuoBenchError
from duobench.hardware.clock import Clock, Ticker
from duobench.hardware.devices import Arm
from duobench.hardware.motion.follower import Follower, MotionLimits
from duobench.hardware.rig import FOLLOWER_HZ
from duobench.types import Array


class Leader:
    """Leads one arm along the path of its follower. Its methods may be called from any thread."""

    def __init__(self, arm: Arm, follower: Follower, clock: Clock) -> None:
        """Begin stopped."""
        self._arm, self._follower, self._clock = arm, follower, clock
        self._lock = threading.RLock()  # a signal may ask for a hold inside of it
        self._ticker: Ticker | None = None
        self._last = 0.0
        self._late = 0.0
        self.error: str | None = None
        """Why the arm could not be told where to be, if it could not."""

    def start(self, joints: Array) -> None:
        """Lead the arm, at rest at its measured joints (7,) until it is told where to go."""
        with self._lock:
            self._follower.reset(joints)
            self.error, self._late, self._last = None, 0.0, self._clock.now()
        self._ticker = self._clock.every(1.0 / FOLLOWER_HZ, self._advance, "follower")

    def stop(self) -> None:
        """Lead no more; stopping twice is harmless."""
        ticker, self._ticker = self._ticker, None
        if ticker is not None:
            ticker.stop()
        self.hold()

    def limit(self, limits: MotionLimits) -> None:
        """Bound the arm by other limits from now on."""
        with self._lock:
            self._follower.limits = limits

    def aim(self, joints: Array) -> None:
        """Approach a target (7,) in radians over the next control period."""
        with self._lock:
            self._follower.aim(joints)

    def hold(self) -> None:
        """Come to rest."""
        with self._lock:
            self._follower.hold()

    @property
    def is_at_rest(self) -> bool:
        """Whether the arm is told to stand still."""
        with self._lock:
            return self._follower.is_at_rest

    @property
    def reference(self) -> Array:
        """Where the arm is told to be (7,), in radians."""
        with self._lock:
            return self._follower.reference.copy()

    def take_lateness(self) -> float:
        """The longest time in seconds between two calls since this was last asked."""
        with self._lock:
            waiting = self._clock.now() - self._last
            late, self._late = max(self._late, waiting), 0.0
            return late

    def _advance(self) -> None:
        with self._lock:
            now = self._clock.now()
            dt, self._last = now - self._last, now
            self._late = max(self._late, dt)
            joints, velocities = self._follower.advance(dt)
        try:
            self._arm.command(joints, velocities)
        except DuoBenchError as error:
            self.error = str(error)
