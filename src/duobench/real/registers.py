"""The registers of a real gripper, as its manual describes them; others move the fingers.

The rehearsal and an imitated gripper on a serial line answer by this one model.
"""

from collections.abc import Sequence

ACTIVATE, GO = 1 << 8, 1 << 11
"""Bits rACT and rGTO of the first register of the command."""
RESET, ACTIVATING, ACTIVE = 0, 1, 3
"""Values of gSTA, the state of the activation."""
MOVING, STOPPED_OPENING, STOPPED_CLOSING, AT_GOAL = 0, 1, 2, 3
"""Values of gOBJ: fingers on their way, stopped at an object, or at their target."""
ENDS = (3, 228)
"""Positions, 0 open to 255 closed, at which the fingers of a typical gripper end."""
REACHED = 2.0
"""Counts from a goal that count as there: one is a third of a millimetre."""
BLOCKED_S = 0.1
"""Seconds without movement after which something is in the way."""


class GripperRegisters:
    """Registers of a gripper: its status and the target of its fingers.

    The owner of the fingers calls `move` with their position as time passes, and leads them to
    `target`.
    """

    def __init__(self, *, is_active: bool = False) -> None:
        self.ends = ENDS
        self.has_power = True
        """Whether its supply is on; without it, it answers nothing and keeps what it holds."""
        self.fault = 0
        """gFLT; a fault stays until the gripper is reset."""
        self.jams = False
        """Whether an activation never ends."""
        self.position = float(ENDS[0])
        """Position of the fingers, in counts."""
        self._state = ACTIVE if is_active else RESET
        self._goes = False
        self._goal = 0
        self._activation: list[int] = []  # ends that are still to be visited
        self._is_blocked = False
        self._seen, self._moved_at = (
            self.position,
            -1.0,
        )  # where they were when they last moved

    def lose_power(self) -> None:
        """Cut the supply; the activation is lost with it."""
        self.has_power, self.fault = False, 0
        self._reset()

    @property
    def target(self) -> float | None:
        """Target of the fingers in counts; None while they stay as they are."""
        if self._activation:
            return float(self._activation[0])
        if self._state != ACTIVE or not self._goes:
            return None
        return float(min(max(self._goal, self.ends[0]), self.ends[1]))

    def write(self, values: Sequence[int]) -> None:
        """Obey three command registers: action bits, goal, speed and force."""
        action, goal = values[0], values[1] & 0xFF
        is_new = (goal, bool(action & GO)) != (self._goal, self._goes)
        self._goal, self._goes = goal, bool(action & GO)
        if not action & ACTIVATE:
            self.fault = 0
            self._reset()
        elif self._state == RESET:
            self._state, self._activation = ACTIVATING, [self.ends[1], self.ends[0]]
            is_new = True
        if is_new:
            self._is_blocked, self._moved_at = False, -1.0

    @property
    def contact(self) -> int:
        """Value of gOBJ."""
        target = self.target
        if target is None:
            return AT_GOAL
        if self._is_blocked:
            return STOPPED_CLOSING if target > self.position else STOPPED_OPENING
        return MOVING if abs(target - self.position) > REACHED else AT_GOAL

    @property
    def has_object(self) -> bool:
        """Whether something is between the fingers that they close on."""
        return self.contact == STOPPED_CLOSING

    def read(self) -> list[int]:
        """The three status registers."""
        contact = self.contact
        active = self._state != RESET
        bits = active | self._goes << 3 | self._state << 4 | contact << 6
        return [bits << 8, self.fault << 8 | self._goal, round(self.position) << 8]

    def move(self, position: float, now: float) -> None:
        """Say where the fingers are, in counts, at a time in seconds."""
        self.position = position
        if self._moved_at < 0.0 or abs(position - self._seen) > 0.5:  # noqa: PLR2004 - half a count
            self._seen, self._moved_at = position, now
            self._is_blocked = False
        target = self.target
        if target is None:
            return
        is_there = abs(target - position) <= REACHED
        if not is_there and now - self._moved_at >= BLOCKED_S:
            self._is_blocked = True
        if self._activation and (is_there or self._is_blocked) and not self.jams:
            self._activation.pop(0)
            self._is_blocked, self._moved_at = False, now
            if not self._activation:
                self._state = ACTIVE

    def _reset(self) -> None:
        self._state = RESET
        self._activation = []
        self._is_blocked = False
