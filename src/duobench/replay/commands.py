"""What somebody who views may ask for."""

from __future__ import annotations

from typing import Annotated

import msgspec

from duobench.errors import MessageError


class Select(msgspec.Struct, tag="select", tag_field="kind", frozen=True):
    """Show an item, from its beginning."""

    id: Annotated[str, msgspec.Meta(max_length=300)]


class Seek(msgspec.Struct, tag="seek", tag_field="kind", frozen=True):
    """Go to a control step."""

    step: Annotated[int, msgspec.Meta(ge=0, le=10**9)]


class Play(msgspec.Struct, tag="play", tag_field="kind", frozen=True):
    """Go on, or stop."""

    on: bool


Command = Select | Seek | Play
_decoder = msgspec.json.Decoder(Command)


def read_command(data: bytes) -> Command:
    """Read a command.

    Raises:
        MessageError: It is none.
    """
    try:
        return _decoder.decode(data)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise MessageError(
            f"Here one selects, seeks and plays; got something else: {error}."
        ) from error
