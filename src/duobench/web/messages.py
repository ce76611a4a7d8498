"""What a page and its server say to each other, as far as every use of the page has it in common.

Text is JSON with a `kind`. A frame is binary, little-endian: float64 time of the server in seconds,
uint32 control step, uint32 number of bodies, then seven float32 a body.
"""

from __future__ import annotations

import struct
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from duobench.errors import MessageError

MAX_MESSAGE = 4096
"""Bytes of a message from a page."""
FRAMES_HZ = 30.0
"""Most frames a second that a page is sent."""
_FRAME = struct.Struct("<dII")


class PageMessage(msgspec.Struct, frozen=True):
    """What every message from a page holds; what else it holds is for those who act on it."""

    kind: Annotated[str, msgspec.Meta(min_length=1, max_length=32)]
    """What it is about."""
    sent: float | None = None
    """When it was sent, in milliseconds of the page's clock."""


_decoder = msgspec.json.Decoder(PageMessage)


def read_message(data: str | bytes) -> PageMessage:
    """Read what every message from a page holds.

    Args:
        data: A message as it arrived.

    Raises:
        MessageError: It is binary, no JSON, or no object with a kind.
    """
    if isinstance(data, bytes):
        raise MessageError("A message from a page is text.")
    try:
        return _decoder.decode(data)
    except (msgspec.MsgspecError, RecursionError, UnicodeError) as error:
        raise MessageError(f"A message cannot be read: {error}.") from error


def pack_frame(poses: NDArray[np.float32], step: int, time_s: float) -> bytes:
    """A frame as it is sent.

    Args:
        poses: Positions in metres and quaternions (bodies, 7), as `Geometry.poses` gives them.
        step: Control steps of the episode so far.
        time_s: Time in seconds on a clock of the server that never goes back.
    """
    return _FRAME.pack(time_s, step, len(poses)) + poses.astype("<f4").tobytes()


def unpack_frame(data: bytes) -> tuple[NDArray[np.float32], int, float]:
    """Poses (bodies, 7), step and time of a frame.

    Raises:
        MessageError: It is none.
    """
    try:
        time_s, step, bodies = _FRAME.unpack_from(data)
        poses = np.frombuffer(data, "<f4", offset=_FRAME.size).reshape(bodies, 7)
    except (struct.error, ValueError) as error:
        raise MessageError(f"This is no frame: {error}.") from error
    return poses.astype(np.float32), step, time_s


def encode(**fields: Any) -> str:
    """A message as JSON text; numbers that are none become null."""
    return msgspec.json.encode(fields).decode()
