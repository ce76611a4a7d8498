"""Protocol of a device that leads: hands over a network, or leader arms."""

from dataclasses import dataclass
from typing import Protocol

from duobench.core.types import Array, DuoCommand, DuoState
from duobench.teleop.messages import Message


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Intent:
    """Action of one control step that the operator leads, and how."""

    action: Array
    """The action (16,), in the action mode of the device."""
    clutch: tuple[bool, bool]
    """Whether the left and the right hand lead their arm."""
    limited: tuple[bool, bool] = (False, False)
    """Whether an arm was kept from where its hand wants it."""
    leads: bool = True
    """Whether an arm is led now. Where none is, and the fingers rest too, the world comes to rest
    and stands still; see `pace`."""


class TeleopDevice(Protocol):
    """Device with which an operator leads both arms."""

    action_mode: str
    """Name of what the numbers of its actions mean."""
    led_by: str
    """Devices that have led since the episode began: "mouse and gamepad"; empty if unknown."""
    executed_ms: float
    """Time at which the newest executed sample was sent, in ms of the page's clock; NaN without."""

    def begin(self, command: DuoCommand) -> None:
        """A new episode waits for the operator, with the arms where they are commanded to be."""

    def follow(self, command: DuoCommand) -> None:
        """Something else leads the arms, which are commanded to be there: it can be taken over.

        Raises:
            LeaderError: The operator cannot let go of the device, so nothing else can lead.
        """

    def let_go(self) -> None:
        """Let the operator let go, before they lead again."""

    def take(self, message: Message, arrival_s: float) -> None:
        """A message of the operator has arrived; the device may have no use for it."""

    def lose(self) -> None:
        """The operator has gone: everything is let go."""

    def is_away(self, now_s: float) -> bool:
        """Whether no operator has led for so long that the recording waits."""
        ...

    def prompt(self, now_s: float) -> str | None:
        """Return what to do before the episode begins; None once it has begun."""
        ...

    def is_squeezed_anew(self, now_s: float) -> bool:
        """Whether a hand that let go after a hold would lead again."""
        ...

    def intend(
        self,
        now_s: float,
        state: DuoState,
        command: DuoCommand,
    ) -> Intent:
        """The next action, from where the arms are and where they were commanded to be last."""
        ...

    @property
    def was_lost(self) -> bool:
        """Whether hands that led last were lost, and not opened."""
        ...

    @property
    def clutch(self) -> tuple[bool, bool]:
        """Whether the left and the right hand lead their arm."""
        ...

    @property
    def dropped(self) -> int:
        """Samples that arrived too late."""
        ...

    @property
    def sampled_s(self) -> float | None:
        """Time at which the newest sample arrived, in seconds; None before the first one."""
        ...
