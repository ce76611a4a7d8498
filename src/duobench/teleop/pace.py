"""Pace of a session: the world runs while an operator leads, and then until all is at rest.

While the operator thinks or looks, the world stands still, and nothing is recorded.
"""

from collections import deque
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from duobench.core.types import CONTROL_HZ, Array, DuoState
from duobench.envs.spaces import opening_slots
from duobench.teleop.intent import Intent

LONGEST_REST_S = 3.0
"""Longest time in seconds that the world goes on after the operator has led."""
QUIET_S = 0.5
"""Seconds that everything has been at rest when the world stops: what turns round, as a ball on a
slope does, stands still for a moment too."""
OPENING_MOVED = 0.02
"""Change of an opening, 0 to 1, that is more than the noise of a trigger or of a gripper."""
SMOOTHED = 10
"""Turns over which noise is averaged out."""


class Phase(StrEnum):
    """Reason why the world runs, or that it stands still."""

    LED = "led"
    """The operator leads."""
    RESTING = "resting"
    """Something still moves, or a clock of a stage counts."""
    ALONE = "alone"
    """It runs at the operator's word."""
    STANDING = "standing"
    """It stands still; on a rig the arms hold, and nothing is recorded."""


class Movement:
    """Tells numbers that move from noise.

    Numbers move once their mean over the last turns has left its value at the last motion by more
    than noise. So a slow motion is seen as well as a quick one, only later.

    Args:
        noise: Largest change of each that may be noise.
    """

    def __init__(self, noise: ArrayLike) -> None:
        self._noise = np.asarray(noise, dtype=np.float64)
        self._recent: deque[Array] = deque(maxlen=SMOOTHED)
        self._last: Array | None = None

    def sees(self, numbers: Array) -> bool:
        """Whether the numbers of one more turn move; the first ones do not."""
        self._recent.append(numbers)
        mean = np.mean(self._recent, axis=0)
        if self._last is None:
            self._last = mean
        if (np.abs(mean - self._last) <= self._noise).all():
            return False
        self._last = mean
        return True


class Pace:
    """Decides turn by turn whether the world runs."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """An episode begins, and is led."""
        self.phase = Phase.LED
        self.is_alone = False
        """Whether the world runs whatever the operator does."""
        self._openings = Movement(np.full(4, OPENING_MOVED))
        self._after_led = self._quiet = 0

    def runs(
        self,
        intent: Intent,
        state: DuoState,
        *,
        ends: bool = False,
    ) -> bool:
        """Whether the world runs in this turn.

        Args:
            intent: Wish of the operator; moving fingers count as leading, whatever the clutches do.
            state: State of the arms.
            ends: Whether the episode ends by itself, so that the world goes on without leading.
        """
        asked = intent.action[opening_slots(len(intent.action))]
        grips = self._openings.sees(np.concatenate([asked, state.openings]))
        if intent.leads or grips:
            self.phase = Phase.LED
            self._after_led = self._quiet = 0
        elif self.is_alone:
            self.phase = Phase.ALONE
        elif self._is_over and not ends:
            self.phase = Phase.STANDING
        else:
            self.phase = Phase.RESTING
        return self.phase is not Phase.STANDING

    def note_step(self, *, is_at_rest: bool) -> None:
        """A control step was made, after which everything is at rest, or is not."""
        if self.phase is not Phase.LED:
            self._after_led += 1
            self._quiet = self._quiet + 1 if is_at_rest else 0

    @property
    def _is_over(self) -> bool:
        """Whether everything has rested long enough, or moved for too long."""
        is_quiet = self._quiet >= round(QUIET_S * CONTROL_HZ)
        return is_quiet or self._after_led >= round(LONGEST_REST_S * CONTROL_HZ)
