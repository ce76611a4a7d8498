"""Messages of an operator during a session at a rig, on a page or at a terminal."""

from typing import Annotated

import msgspec

from duobench.core.errors import escaped
from duobench.core.types import SIDES, Side
from duobench.teleop.messages import Hold
from duobench.web.messages import PageMessage

LONGEST_TEXT = 300
"""Characters of a note or a reason."""


def _check_line(text: str) -> None:
    if text != escaped(text) or len(text.splitlines()) > 1 or text != text.strip():
        raise ValueError("a note or a reason is one line that can be printed")


class Alive(PageMessage, frozen=True):
    """The page is open, and its buttons can be pressed."""


class Home(PageMessage, frozen=True):
    """The operator confirms that both arms may go home, slowly."""

    with_object: bool = False
    """Whether what one hand holds may be carried home, where it is let go."""


class Activate(PageMessage, frozen=True):
    """The operator wants grippers activated: nothing is between their fingers."""


class Open(PageMessage, frozen=True):
    """The operator wants hands opened, which drop what they hold."""

    hands: tuple[Side, ...] = SIDES


class Placed(PageMessage, frozen=True):
    """The objects are where they shall be."""


class PlaceAgain(PageMessage, frozen=True):
    """They are not, after all."""


class Start(PageMessage, frozen=True):
    """The operator confirms that the arms may move, and the policy begins."""


class Stage(PageMessage, frozen=True):
    """A stage is reached."""

    stage: Annotated[int, msgspec.Meta(ge=1, le=99)]
    time_s: Annotated[float, msgspec.Meta(ge=0.0, le=36000.0)] | None = None
    """Time at which it was reached, in seconds of the film of a finished episode; None is now."""


class Undo(PageMessage, frozen=True):
    """The latest press that stands is taken back."""


class GiveUp(PageMessage, frozen=True):
    """The policy that is waited for is given up: it has failed."""


class AtEnd(PageMessage, frozen=True):
    """Whether the last stage still held at the end."""

    holds: bool


class Note(PageMessage, frozen=True):
    """A remark about the episode."""

    text: Annotated[str, msgspec.Meta(max_length=LONGEST_TEXT)]
    """The remark; it takes the place of the one before."""

    def __post_init__(self) -> None:
        _check_line(self.text)


class Finish(PageMessage, frozen=True):
    """The episode counts as it was judged, or is kept."""


class Invalid(PageMessage, frozen=True):
    """It does not count, and is played again, or it is discarded."""

    reason: Annotated[str, msgspec.Meta(min_length=1, max_length=LONGEST_TEXT)]

    def __post_init__(self) -> None:
        _check_line(self.reason)


class Recover(PageMessage, frozen=True):
    """The operator has looked at the fault, and wants it cleared; nothing moves."""


Message = (
    Alive | Home | Activate | Open | Placed | PlaceAgain | Start | Stage | Undo | Hold | GiveUp
    | AtEnd | Note | Finish | Invalid | Recover
)  # fmt: skip
