"""What an operator says during a session at a rig, on a page or at a terminal.

Nothing that a page sends is trusted: a message that is not exactly of its kind is refused.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from duobench.errors import MessageError, escaped

LONGEST_TEXT = 300
"""Characters of a note or a reason."""

_STRICT = {"frozen": True, "forbid_unknown_fields": True, "tag_field": "kind"}


class Alive(msgspec.Struct, tag="alive", **_STRICT):
    """The page is open, and somebody can press its buttons."""


class Home(msgspec.Struct, tag="home", **_STRICT):
    """The operator confirms that both arms may go home, slowly."""


class Placed(msgspec.Struct, tag="placed", **_STRICT):
    """The objects are where they shall be."""


class PlaceAgain(msgspec.Struct, tag="place_again", **_STRICT):
    """They are not, after all."""


class Start(msgspec.Struct, tag="start", **_STRICT):
    """The operator confirms that the arms may move, and the policy begins."""


class Stage(msgspec.Struct, tag="stage", **_STRICT):
    """A stage is reached."""

    stage: Annotated[int, msgspec.Meta(ge=1, le=99)]
    """Its number."""
    time_s: Annotated[float, msgspec.Meta(ge=0.0, le=36000.0)] | None = None
    """When it was reached, in seconds of the film of an episode that is over; None for now."""


class Undo(msgspec.Struct, tag="undo", **_STRICT):
    """The latest press that stands is taken back."""


class Hold(msgspec.Struct, tag="hold", **_STRICT):
    """Both arms come to rest and are held."""


class AtEnd(msgspec.Struct, tag="at_end", **_STRICT):
    """Whether the last stage still held at the end."""

    holds: bool
    """Whether it did."""


class Note(msgspec.Struct, tag="note", **_STRICT):
    """A remark about the episode."""

    text: Annotated[str, msgspec.Meta(max_length=LONGEST_TEXT)]
    """The remark; it takes the place of the one before."""


class Finish(msgspec.Struct, tag="finish", **_STRICT):
    """The episode counts as it was judged, or is kept."""


class Invalid(msgspec.Struct, tag="invalid", **_STRICT):
    """It does not count, and is played again, or it is discarded."""

    reason: Annotated[str, msgspec.Meta(min_length=1, max_length=LONGEST_TEXT)]
    """Why."""


class Recover(msgspec.Struct, tag="recover", **_STRICT):
    """The operator has looked at the fault, and wants it cleared; nothing moves."""


Message = (
    Alive | Home | Placed | PlaceAgain | Start | Stage | Undo | Hold | AtEnd | Note | Finish
    | Invalid | Recover
)  # fmt: skip
_decoder = msgspec.json.Decoder(Message)


def read(data: bytes) -> Message:
    """A message from what anybody may have sent.

    Raises:
        MessageError: It is none; or a text is no line that can be printed.
    """
    try:
        message = _decoder.decode(data)
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
        raise MessageError(f"This message is refused: {error}.".replace("`$.", "`")) from error
    text = message.text if isinstance(message, Note) else getattr(message, "reason", "")
    if text != escaped(text) or len(text.splitlines()) > 1 or text != text.strip():
        raise MessageError("A note or a reason is one line that can be printed.")
    return message
