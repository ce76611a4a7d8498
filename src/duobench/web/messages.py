"""Messages between a page and its server that every use of the page has in common.

Text is JSON with a `kind`. Nothing that a page sends is trusted: a message that is not exactly of
its kind is refused with a sentence, and changes nothing. A frame is binary, little-endian: float64
time of the server in seconds, uint32 control step, uint32 number of bodies, float64 when the newest
message of hands was sent that it shows, in ms of the clock of who sent it, or NaN, then seven
float32 a body, and where arms are led seven a tool; see `teleop.plumb.PlumbLines.rows`.
"""

import math
import re
import struct
from collections.abc import Callable
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import MessageError

MAX_MESSAGE = 4096
"""Bytes of a message from a page."""
FRAMES_HZ = 30.0
"""Most frames a second that a page is sent."""
_FRAME = struct.Struct("<dIId")


def _kind(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()


class PageMessage(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag=_kind
):
    """A message from a page; the `kind` of a class `TakeOver` below this one is "take_over"."""


class Ping(PageMessage, frozen=True):
    """The page asks whether the server is there."""

    sent: float | None = None
    """When it was sent, in milliseconds of the page's clock."""


class Drive(PageMessage, frozen=True):
    """Visitor's request to drive, if no other visitor drives."""


class TakeOver(PageMessage, frozen=True):
    """Visitor's request to drive in the place of the present driver."""


class SelectItem(PageMessage, frozen=True, tag="select"):
    """Choose an item of those that the page lists."""

    id: Annotated[str, msgspec.Meta(max_length=300)]


def reader(kinds: Any) -> Callable[[str | bytes], Any]:
    """Reader of messages that a page may have sent.

    Args:
        kinds: The classes below `PageMessage` that are understood, as one or a union of them.

    Returns:
        Gives the message in a text. It raises a `MessageError` where that is binary, no JSON, of no
        known kind, with a field too many or too few, of a wrong type, or out of range.
    """
    decoder = msgspec.json.Decoder(kinds)

    def read(data: str | bytes) -> Any:
        if isinstance(data, bytes):
            raise MessageError("A message from a page is text.")
        try:
            return decoder.decode(data)
        except (msgspec.MsgspecError, RecursionError, UnicodeError) as error:
            raise MessageError(
                f"This message is refused: {error}.".replace("`$.", "`")
            ) from error

    return read


def pack_frame(
    poses: NDArray[np.float32],
    step: int,
    time_s: float,
    shows_ms: float = math.nan,
    tools: NDArray[np.float32] | None = None,
) -> bytes:
    """A frame of poses (bodies, 7), as `Geometry.poses` gives them, after so many control steps.

    The time is that of a clock of the server that never goes back; `shows_ms` and `tools` as said
    above.
    """
    head = _FRAME.pack(time_s, step, len(poses), shows_ms)
    rows = poses if tools is None else np.concatenate([poses, tools])
    return head + rows.astype("<f4").tobytes()


def encode(**fields: Any) -> str:
    """Message as JSON text; NaN and infinite numbers become null."""
    return msgspec.json.encode(fields).decode()
