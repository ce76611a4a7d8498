"""Steps at a rig before anything plays: what stands in the way, and the buttons that clear it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from duobench.core.types import SIDES, Side
from duobench.real.duo import FrankaDuo
from duobench.real.sessions import messages
from duobench.teleop.panel import Button
from duobench.web.messages import PageMessage

READY, HOME, PLACED = "Activate", "Home", "Placed"
"""First steps of every session at a rig."""
CARRY = "carry"
"""Name of the button that carries home what one hand holds."""
STEPS = (READY, HOME, PLACED)
BETWEEN_FINGERS = "Take away what is between the fingers, which will close and open."
TO_HOME = "Clear the space of the arms: they go home slowly, and open their grippers."
TO_PLACE = "Place the objects, then step back: the arms may move."
RECOVER_BUTTON = Button(
    id="recover",
    words="I have looked: recover",
    message=messages.Recover(),
    key="r",
    is_next=True,
)
ACTIVATE_BUTTON = Button(
    id="activate",
    words="Nothing is between the fingers: activate",
    message=messages.Activate(),
    key="a",
    is_next=True,
)
HOME_BUTTON = Button(
    id="home",
    words="Nobody is near: home",
    message=messages.Home(),
    key="h",
)
PLACED_BUTTON = Button(
    id="placed",
    words="Placed: the arms may move",
    message=messages.Placed(),
    key="p",
)


@dataclass(frozen=True, kw_only=True, slots=True)
class Hindrance:
    """Something that keeps the arms from moving."""

    todo: str
    """Sentences for the operator."""
    why_not: str
    """The same in a few words."""
    buttons: tuple[Button, ...]
    """Buttons that clear it, the best first."""


def find_hindrance(duo: FrankaDuo) -> Hindrance | None:
    """Return what has to be cleared first; None where the arms may go home."""
    inactive, holding = duo.hands.to_activate, duo.hands.holding
    if duo.fault is not None:
        todo = f"Something is wrong: {duo.fault.text} Set it right, then recover."
        buttons = (RECOVER_BUTTON,)
        if inactive:
            todo += f" To activate the {_named(inactive)} gripper may clear it. {BETWEEN_FINGERS}"
            buttons = (RECOVER_BUTTON, replace(ACTIVATE_BUTTON, is_next=False))
        return Hindrance(
            todo=todo,
            why_not="a fault stands",
            buttons=buttons,
        )
    if inactive:
        which = _named(inactive)
        return Hindrance(
            todo=f"Not active since it was switched on: the {which} gripper. {BETWEEN_FINGERS}",
            why_not=f"the {which} gripper is not active",
            buttons=(ACTIVATE_BUTTON,),
        )
    if holding:
        which = _named(holding)
        return Hindrance(
            todo=f"The {which} hand holds something. Take it before you open the hand: it drops.",
            why_not=f"the {which} hand holds something",
            buttons=_opening(holding),
        )
    return None


def clear(duo: FrankaDuo, message: PageMessage) -> None:
    """Do what a message of the operator says about a fault or the grippers.

    Raises:
        BackendError: It was not done, or stopped by a hold.
    """
    match message:
        case messages.Recover():
            duo.supervisor.recover()
        case messages.Activate():
            duo.hands.activate()
        case messages.Open(hands=hands):
            duo.hands.open(hands)
        case _:
            pass


def _opening(holding: Sequence[Side]) -> tuple[Button, ...]:
    """Buttons that open the hands that hold something, or carry home what one of them holds."""
    is_both = len(holding) == len(SIDES)
    one_by_one = tuple(
        Button(
            id=f"open_{side}",
            words=f"Open the {side} hand",
            message=messages.Open(hands=(side,)),
            key=side[0],
            is_next=not is_both,
        )
        for side in holding
    )
    if is_both:
        both = Button(
            id="open_both",
            words="Open both hands",
            message=messages.Open(),
            key="b",
            is_next=True,
        )
        return (both, *one_by_one)
    carry = Button(
        id=CARRY,
        words="Home with what it holds",
        message=messages.Home(with_object=True),
        key="c",
    )
    return (*one_by_one, carry)


def _named(sides: Sequence[Side]) -> str:
    """Sides in words."""
    return " and ".join(sides)
