"""Calls of RPyC 6: methods of a server's root object, with texts as arguments.

Only what that takes is spoken. The other side can ask nothing of this one: there are no attributes
to reach, no objects to call back, no pickles, and no exceptions to make here.
"""

from __future__ import annotations

import itertools
import socket
import struct
import time
import zlib
from typing import Any

from duobench.errors import LONGEST_TEXT, MessageError, ServingError, printable
from duobench.policy.serving import limits
from duobench.policy.serving.brine import dump, load

_HEADER = struct.Struct("!LB")
"""Before every message: how many bytes it has, and whether they are compressed."""
_END = b"\n"
"""After every message."""
_PIECE = 1 << 16
_REQUEST, _REPLY, _EXCEPTION = 1, 2, 3
_VALUE, _TUPLE, _YOURS, _MINE = 1, 2, 3, 4
"""What a value is: itself, a tuple of such, an object of the receiver or of the sender."""
_CLOSE, _ROOT, _ATTRIBUTE, _CALL = 2, 3, 4, 8
"""Requests."""


class CallError(ServingError):
    """The method that was called raised an error; the message is its traceback."""


class CallConnection:
    """A connection over which methods are called, one after the other."""

    def __init__(self, host: str, port: int, deadline: float) -> None:
        """Connect.

        Args:
            host: Name or address of the server.
            port: Its port.
            deadline: When to give up, on the clock of `time.monotonic`.

        Raises:
            OSError: If there is no server.
            EOFError: If it ends the connection.
            TimeoutError: If it takes too long.
            MessageError: If what comes cannot be read.
        """
        self._deadline = deadline
        self._numbers = itertools.count()
        timeout = min(limits.HANDSHAKE_S, self._left())
        self._socket = socket.create_connection((host, port), timeout)
        try:
            label, self._root = self._ask(_ROOT, (_VALUE, ()))
            if label != _MINE or not _is_reference(self._root):
                raise MessageError("The server has no object whose methods can be called.")
        except BaseException:
            self.close()
            raise

    def call(self, name: str, *arguments: str, deadline: float) -> Any:
        """Call a method.

        Args:
            name: Its name.
            arguments: What it is called with.
            deadline: When to give up, on the clock of `time.monotonic`. After that, and after
                any other error but `CallError`, nothing more may be asked.

        Returns:
            What it returns, if that is a plain value.

        Raises:
            CallError: If it raises an error.
            OSError: If the connection is lost; if there is no answer in time, a `TimeoutError`.
            EOFError: If the server ends the connection.
            MessageError: If what comes cannot be read, or is no plain value.
        """
        self._deadline = deadline
        what = ((_YOURS, self._root), (_VALUE, name), (_VALUE, arguments), (_VALUE, ()))
        label, value = self._ask(_CALL, (_TUPLE, what))
        if label != _VALUE:
            raise MessageError(f"{name} returned an object, no plain value.")
        return value

    def has(self, name: str, *, deadline: float) -> bool:
        """Whether there is a method of that name; errors are those of `call`."""
        self._deadline = deadline
        try:
            self._ask(_ATTRIBUTE, (_TUPLE, ((_YOURS, self._root), (_VALUE, name))))
        except CallError:
            return False
        return True

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def _ask(self, handler: int, arguments: tuple[Any, ...]) -> tuple[Any, Any]:
        """Send a request and wait for its answer, a label and a value."""
        number = next(self._numbers)
        message = bytes([_REQUEST]) + dump((number, (handler, arguments)))
        self._socket.settimeout(self._left())
        self._socket.sendall(_HEADER.pack(len(message), 0) + message + _END)
        kind, answered, content = self._receive()
        if kind == _REQUEST and isinstance(content, tuple) and content[:1] == (_CLOSE,):
            raise EOFError("the server ended it")
        if answered != number or kind not in {_REPLY, _EXCEPTION}:
            raise MessageError("Something came that answers no question.")
        if kind == _EXCEPTION:
            raise CallError(_told(content))
        if not isinstance(content, tuple) or len(content) != 2:  # noqa: PLR2004 - label and value
            raise MessageError("An answer is a label and a value.")
        return content

    def _receive(self) -> tuple[int, Any, Any]:
        """The kind of the next message, the number of its request, and what it holds."""
        size, is_compressed = _HEADER.unpack(self._read(_HEADER.size))
        if not 0 < size <= limits.MAX_CALL_REPLY:
            raise MessageError(f"A message has up to {limits.MAX_CALL_REPLY} bytes, not {size}.")
        data = self._read(size + len(_END))[:size]
        if is_compressed:
            data = _decompressed(data)
        match load(data[1:]):
            case (int(number), content):
                return data[0], number, content
        raise MessageError("A message is a number and what belongs to it.")

    def _read(self, count: int) -> bytes:
        data = bytearray()
        while len(data) < count:
            self._socket.settimeout(self._left())
            piece = self._socket.recv(min(_PIECE, count - len(data)))
            if not piece:
                raise EOFError("the server ended it")
            data += piece
        return bytes(data)

    def _left(self) -> float:
        """Seconds until the deadline.

        Raises:
            TimeoutError: If it is over.
        """
        left = self._deadline - time.monotonic()
        if left <= 0:
            raise TimeoutError("there was no answer in time")
        return left


def _decompressed(data: bytes) -> bytes:
    unpacker = zlib.decompressobj()
    try:
        unpacked = unpacker.decompress(data, limits.MAX_CALL_REPLY)
    except zlib.error as error:
        raise MessageError(f"A message cannot be decompressed: {error}.") from error
    if not unpacker.eof or not unpacked:
        raise MessageError(
            f"A compressed message is not whole, or has more than {limits.MAX_CALL_REPLY} bytes."
        )
    return unpacked


def _is_reference(value: object) -> bool:
    """Whether a value names an object of the other side."""
    match value:
        case (str(), int(), int()):
            return True
    return False


def _told(error: object) -> str:
    """What the other side says about an error, for people."""
    match error:
        case ((str(), str(kind)), tuple(arguments), tuple(), str(trace)):
            text = trace if "\n" in trace else f"{kind}: {', '.join(map(str, arguments))}"
        case _:
            text = f"an error without words: {error!r:.200}"
    return printable(text)[-LONGEST_TEXT:].strip()
