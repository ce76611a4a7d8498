"""A connection between a process and the one that has started it."""

from __future__ import annotations

import socket
from typing import Any, Generic, TypeVar

import msgspec

from duobench.errors import DuoBenchError, MessageError

T = TypeVar("T")

_PIECE = 1 << 20
"""Bytes that are read at a time."""


class Channel(Generic[T]):
    """One end of a connection, on which every message is a line of JSON."""

    def __init__(self, connection: socket.socket, kind: Any) -> None:
        """Take a connected socket.

        Args:
            connection: The socket, which belongs to the channel from now on.
            kind: Type of the messages that are received, or a union of such types.
        """
        self.socket = connection
        """The socket, to wait for, and to close."""
        self._decoder = msgspec.json.Decoder(kind)
        self._rest = bytearray()

    def send(self, message: msgspec.Struct) -> None:
        """Send a message.

        Raises:
            OSError: The other end is closed.
        """
        self.socket.sendall(msgspec.json.encode(message) + b"\n")

    def receive(self) -> list[T]:
        """Read what has arrived; the messages that are complete.

        It waits only if nothing has arrived: an end of the channel that dies in the middle of a
        message leaves it incomplete, also while a child of it keeps the channel open.

        Raises:
            EOFError: The other end is closed.
            MessageError: A message is none of the expected kind.
        """
        try:
            piece = self.socket.recv(_PIECE)
        except ConnectionError:
            piece = b""
        if not piece:
            raise EOFError
        self._rest += piece
        if b"\n" not in piece:  # of a long message, such as one with a video
            return []
        *lines, self._rest = self._rest.split(b"\n")
        try:
            return [self._decoder.decode(line) for line in lines]
        except (msgspec.MsgspecError, DuoBenchError) as error:
            raise MessageError(str(error)) from error
