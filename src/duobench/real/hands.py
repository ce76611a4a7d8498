"""Both grippers on the operator's word: activated, opened, emptied before the arms go home.

Fingers are never moved by anything else while the arms are held: activation squeezes what is
between them, and opening drops it.
"""

from collections.abc import Mapping, Sequence

from duobench.core.errors import BackendError
from duobench.core.types import SIDES, Side
from duobench.real.clock import Clock
from duobench.real.devices import Gripper
from duobench.real.supervisor import Supervisor

OPEN = 0.9
"""Opening from which a gripper counts as open."""
OPENING_S = 5.0
"""Seconds in which a gripper has to open."""
_LOOK_S = 1.0 / 30.0


class GripperPair:
    """The grippers of a rig, as a person uses them; a hold stops the fingers."""

    def __init__(
        self, grippers: Mapping[Side, Gripper], supervisor: Supervisor, clock: Clock
    ) -> None:
        self._grippers = grippers
        self._supervisor = supervisor
        self._clock = clock
        self.have_grasped = False
        """Whether there may be something between the fingers, or around them, since the arms were
        home."""

    @property
    def inactive(self) -> tuple[Side, ...]:
        """Sides whose gripper was not activated since it was switched on, and does not move."""
        return tuple(
            side for side in SIDES if not self._grippers[side].read().is_active
        )

    @property
    def to_activate(self) -> tuple[Side, ...]:
        """Sides whose gripper is not active, or has a fault that activation may clear."""
        readings = {side: self._grippers[side].read() for side in SIDES}
        return tuple(
            side
            for side, each in readings.items()
            if not each.is_active or each.fault is not None
        )

    @property
    def holding(self) -> tuple[Side, ...]:
        """Sides whose gripper holds something."""
        return tuple(side for side in SIDES if self._grippers[side].read().has_object)

    def check_active(self) -> None:
        """Raise BackendError while a gripper is not active: it would ignore all commands."""
        inactive = self.inactive
        if inactive:
            raise BackendError(
                f"{_named('gripper', inactive)} not active, and would not move: activate the "
                "grippers first, with nothing between the fingers."
            )

    def check_free(self, *, with_object: bool = False) -> None:
        """Raise BackendError where going home would pull something apart, or carry it along.

        What one hand holds may be carried home, and is let go there, if `with_object` says so.
        """
        holding = self.holding
        if len(holding) == len(SIDES):
            raise BackendError(
                "Both hands hold something, which the way home would pull apart: open them first."
            )
        if holding and not with_object:
            raise BackendError(
                f"The {holding[0]} hand holds something: open it first, or say that it may be "
                "carried home, where it is let go."
            )

    def activate(self) -> None:
        """Activate those that are not active, or not well; fingers move through their whole range.

        Raises:
            BackendError: One did not become active, or a hold stopped it.
        """
        with self._supervisor.handling() as may_go_on:
            for side in self.to_activate:
                if not may_go_on():
                    raise BackendError("The activation was stopped.")
                self._grippers[side].activate()

    def open(self, sides: Sequence[Side] = SIDES) -> None:
        """Open some hands, which drop what they hold; the arms stay as they are.

        Raises:
            BackendError: One did not open, is not active, or a hold stopped it.
        """
        with self._supervisor.handling() as may_go_on:
            self.check_active()
            self.have_grasped = True
            for side in sides:
                self._grippers[side].command(1.0)
            end = self._clock.now() + OPENING_S
            while closed := [
                side for side in sides if self._grippers[side].read().opening < OPEN
            ]:
                if not may_go_on():
                    raise BackendError("The hands were stopped while they opened.")
                if self._clock.now() > end:
                    raise BackendError(
                        f"{_named('hand', tuple(closed))} not open after {OPENING_S:g} s."
                    )
                self._clock.wait_until(self._clock.now() + _LOOK_S)


def _named(what: str, sides: tuple[Side, ...]) -> str:
    return (
        f"Both {what}s are" if len(sides) == len(SIDES) else f"The {sides[0]} {what} is"
    )
