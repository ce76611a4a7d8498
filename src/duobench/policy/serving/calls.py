"""Calls of RPyC 6: methods of a server's root object, with texts as arguments.

Only what that takes is spoken. The other side can ask nothing of this one: there are no attributes
to reach, no objects to call back, no pickles, and no exceptions to make here.
"""

from __future__ import annotations

import itertools
import socket
import struct
import zlib
from collections.abc import Callable
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
    """A connection over which methods are called, one after the other.

    After any error but `CallError`, nothing more may be asked.
    """

    def __init__(self, host: str, port: int, left: Callable[[], float]) -> None:
        """Connect.

        Args:
            host: Name or address of the server.
            port: Its port.
            left: Gives the seconds that everything may still take, at any time.

        Raises:
            OSError: If there is no server; if it takes too long, a `TimeoutError`.
        """
        self._left = left
        self._numbers = itertools.count()
        self._root: object = None
        timeout = min(limits.HANDSHAKE_S, self._remaining())
        self._socket = socket.create_connection((host, port), timeout)

    def call(self, name: str, *arguments: str) -> Any:
        """Call a method.

        Args:
            name: Its name.
            arguments: What it is called with.

        Returns:
            What it returns, if that is a plain value.

        Raises:
            CallError: If it raises an error.
            OSError: If the connection is lost; if there is no answer in time, a `TimeoutError`.
            EOFError: If the server ends the connection.
            MessageError: If what comes cannot be read, or is no plain value.
        """
        label, value = self._ask_root(_CALL, (_VALUE, name), (_VALUE, arguments), (_VALUE, ()))
        if label != _VALUE:
            raise MessageError(f"{name} returned an object, no plain value.")
        return value

    def has(self, name: str) -> bool:
        """Whether there is a method of that name; errors are those of `call`."""
        try:
            self._ask_root(_ATTRIBUTE, (_VALUE, name))
        except CallError:
            return False
        return True

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def _ask_root(self, handler: int, *arguments: tuple[int, Any]) -> tuple[Any, Any]:
        """Ask for something about the server's root object, which is asked for first."""
        if self._root is None:
            match self._ask(_ROOT, (_VALUE, ())):
                case (int(label), (str(), int(), int()) as root) if label == _MINE:
                    self._root = root
                case _:
                    raise MessageError("The server has no object whose methods can be called.")
        return self._ask(handler, (_TUPLE, ((_YOURS, self._root), *arguments)))

    def _ask(self, handler: int, arguments: tuple[Any, ...]) -> tuple[Any, Any]:
        """Send a request and wait for its answer, a label and a value."""
        number = next(self._numbers)
        message = bytes([_REQUEST]) + dump((number, (handler, arguments)))
        self._socket.settimeout(self._remaining())
        self._socket.sendall(_HEADER.pack(len(message), 0) + message + _END)
        kind, answered, content = self._receive()
        if kind == _REQUEST and isinstance(content, tuple) and content[:1] == (_CLOSE,):
            raise EOFError("the server ended it")
        if answered != number or kind not in {_REPLY, _EXCEPTION}:
            raise MessageError("Something came that answers no question.")
        if kind == _EXCEPTION:
            raise CallError(_error_text(content))
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
            self._socket.settimeout(self._remaining())
            piece = self._socket.recv(min(_PIECE, count - len(data)))
            if not piece:
                raise EOFError("the server ended it")
            data += piece
        return bytes(data)

    def _remaining(self) -> float:
        """Seconds that are left.

        Raises:
            TimeoutError: If there are none.
        """
        left = self._left()
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


def _error_text(error: object) -> str:
    """What the other side says about an error, for people."""
    match error:
        case ((str(), str(kind)), tuple(arguments), tuple(), str(trace)):
            text = trace if "\n" in trace else f"{kind}: {', '.join(map(str, arguments))}"
        case _:
            text = f"an error without words: {error!r:.200}"
    return printable(text)[-LONGEST_TEXT:].strip()
