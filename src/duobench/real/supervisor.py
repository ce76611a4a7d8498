"""States of a rig, and the operator's confirmation that lets the arms move.

Nothing moves before the operator confirmed that the arms are free to. A hold takes the confirmation
back; after a fault only the operator recovers the arms.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum

from duobench.core.errors import BackendError
from duobench.results.labels import Fault


class State(StrEnum):
    """State of a rig."""

    OFF = "off"
    """Nothing is connected."""
    CONNECTED = "connected"
    """Everything answers; the arms follow nothing."""
    HOMING = "homing"
    """The arms move home, slowly."""
    READY = "ready"
    """The arms are at home and wait for the first command."""
    RUNNING = "running"
    HOLDING = "holding"
    """The arms are held by a person, without a fault."""
    FAULTED = "faulted"
    """Something is wrong; both arms hold until the operator recovers them."""
    RECOVERING = "recovering"
    """The operator has a fault cleared."""


HELD = (State.HOLDING, State.FAULTED, State.RECOVERING)
"""States in which every command is ignored."""


class Supervisor:
    """The state of one rig. Its methods may be called from any thread.

    `recover` clears the faults of all devices; it raises BackendError where one stays.
    """

    def __init__(self, recover: Callable[[], None]) -> None:
        self._recover = recover
        self._lock = threading.RLock()
        self._state = State.OFF
        self._reason: str | None = None
        self._fault: Fault | None = None
        self._is_confirmed = False
        self._is_handling = False

    @property
    def state(self) -> State:
        """State of the rig."""
        return self._state

    @property
    def fault(self) -> Fault | None:
        """Current fault; None without one, also while a person holds the arms."""
        return self._fault

    @property
    def reason(self) -> str | None:
        """Reason why the arms are held; None otherwise."""
        return self._reason

    @property
    def is_confirmed(self) -> bool:
        """Whether the operator has said that the arms may move."""
        return self._is_confirmed

    @property
    def is_moving(self) -> bool:
        """Whether arms or fingers may move at this moment."""
        return self._is_handling or self._state in {State.HOMING, State.RUNNING}

    @contextmanager
    def handling(self) -> Iterator[Callable[[], bool]]:
        """Surrounds what the operator has the fingers do while the arms stay where they are.

        What it gives says whether they may go on: a hold ends it.
        """
        with self._lock:
            if self._state in {
                State.OFF,
                State.HOMING,
                State.RUNNING,
                State.RECOVERING,
            }:
                raise BackendError(
                    f"Hands are opened and activated while the arms are held; the rig is "
                    f"{self._state}."
                )
            self._is_handling = True
        try:
            yield lambda: self._is_handling
        finally:
            self._is_handling = False

    def confirm(self) -> None:
        """Take the operator's word that no person is near and the arms may move.

        It holds until the arms are held or stopped, or `revoke`.
        """
        with self._lock:
            if self._state in {State.FAULTED, State.RECOVERING}:
                raise BackendError(
                    f"The arms are held: {self._reason} Recover them first, then confirm."
                )
            if self._state is State.OFF:
                raise BackendError(
                    "There is nothing to confirm: the rig is not connected."
                )
            self._is_confirmed = True

    def revoke(self) -> None:
        """Nothing may begin to move any more until the operator confirms again."""
        with self._lock:
            self._is_confirmed = False

    def recover(self) -> None:
        """The operator has all faults cleared. Nothing moves; confirm and go home next."""
        with self._lock:
            if self._state not in {State.FAULTED, State.HOLDING}:
                raise BackendError(
                    f"There is nothing to recover from: the rig is {self._state}."
                )
            reason, fault = self._reason, self._fault
            self._state = State.RECOVERING
        try:
            self._recover()
        except BackendError:
            with self._lock:
                self._reason, self._fault = reason, fault
                self._state = State.FAULTED if fault else State.HOLDING
            raise
        with self._lock:
            self._reason = self._fault = None
            self._is_confirmed = False
            self._state = State.CONNECTED

    def check_confirmed(self) -> None:
        """Reject what would move the arms without the operator's word."""
        with self._lock:
            if self._state in {State.FAULTED, State.RECOVERING}:
                raise BackendError(
                    f"The arms are held: {self._reason} Recover them first."
                )
            if not self._is_confirmed:
                raise BackendError(
                    "Nothing moves before the operator has confirmed that the arms are free to."
                )

    def begin(self, state: State) -> None:
        """Go to a state in which the arms move."""
        with self._lock:
            self.check_confirmed()
            if self._is_handling:
                raise BackendError(
                    "The hands are being opened or activated; wait until they are."
                )
            self.enter(state)

    def enter(
        self, state: State, *, only_from: tuple[State, ...] | None = None
    ) -> bool:
        """Go to a state that is no held one, and forget why the arms were held.

        False, without a change, where the state was none of `only_from`.
        """
        with self._lock:
            if only_from is not None and self._state not in only_from:
                return False
            self._reason = self._fault = None
            if state is State.OFF:
                self._is_confirmed = False
            self._state = state
            return True

    def hold(self, reason: str, fault: Fault | None = None) -> bool:
        """Hold the arms; the first reason is kept, but a fault and its own go over a person's hold.

        Whether this changed anything.
        """
        with self._lock:
            self._is_handling = self._is_confirmed = False
            if self._state is State.OFF or self._fault is not None:
                return False
            if self._reason is not None and fault is None:
                return False
            self._reason, self._fault = reason, fault
            self._state = State.HOLDING if fault is None else State.FAULTED
            return True
