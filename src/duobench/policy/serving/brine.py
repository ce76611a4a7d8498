"""Brine, the format of RPyC's messages: plain values and tuples of them as bytes.

Whole numbers, texts and tuples are written; what else RPyC may send is read as a plain value.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from duobench.errors import MessageError
from duobench.policy.serving import limits

_CONSTANTS = (None, b"", (), True, False, None, None)
"""What the first tags mean; the last two are RPyC's words for `NotImplemented` and `...`."""
_TEXT = 0x08
_BYTES, _BYTES_LONG, _BYTES_LONGER = 0x0A, 0x0E, 0x0F  # 1 to 4 bytes, then with a length of 1 or 4
_TUPLE, _TUPLE_LONG, _TUPLE_LONGER = 0x10, 0x14, 0x15
_INT, _INT_LONG = 0x16, 0x17
_FLOAT, _SLICE, _SET, _COMPLEX = 0x18, 0x19, 0x1A, 0x1B
_SMALL = range(-0x30, 0xA0)
"""Whole numbers that are their own tag, moved by `_SMALL_AT`."""
_SMALL_AT = 0x50
_FEW = 4
_SHORT = 0xFF


def dump(value: object) -> bytes:
    """A value as bytes.

    Args:
        value: A whole number, a text, or a tuple of such values.

    Raises:
        MessageError: If it is something else.
    """
    if type(value) is int:
        if value in _SMALL:
            return bytes([value + _SMALL_AT])
        digits = str(value).encode()
        return bytes([_INT, len(digits)]) + digits
    if isinstance(value, str):
        data = value.encode()
        return bytes([_TEXT]) + _head(len(data), _BYTES, empty=b"") + data
    if isinstance(value, tuple):
        return _head(len(value), _TUPLE, empty=()) + b"".join(map(dump, value))
    raise MessageError(f"Whole numbers, texts and tuples are sent, not {type(value).__name__}.")


def _head(size: int, tag: int, empty: bytes | tuple[()]) -> bytes:
    if not size:
        return bytes([_CONSTANTS.index(empty)])
    if size <= _FEW:
        return bytes([tag + size - 1])
    if size <= _SHORT:
        return bytes([tag + _FEW, size])
    return bytes([tag + _FEW + 1]) + struct.pack("!L", size)


def load(data: bytes) -> Any:
    """A value from bytes that anybody may have sent.

    Returns:
        None, a truth value, a number, a text, bytes, or a tuple of such values.

    Raises:
        MessageError: If it is none of them, or beyond the limits.
    """
    reader = _Reader(data)
    try:
        value = reader.value(0)
    except (UnicodeDecodeError, ValueError) as error:
        raise MessageError(f"A message of RPyC cannot be read: {error!s:.200}.") from error
    if reader.rest:
        raise MessageError(f"A message of RPyC goes on for {reader.rest} bytes after its end.")
    return value


class _Reader:
    """Reads values one after the other, and counts them."""

    def __init__(self, data: bytes) -> None:
        self._data = memoryview(data)
        self._at = 0
        self._items = 0

    @property
    def rest(self) -> int:
        """Bytes that were not read."""
        return len(self._data) - self._at

    def value(self, depth: int) -> Any:
        self._items += 1
        if depth > limits.MAX_DEPTH or self._items > limits.MAX_ITEMS:
            raise MessageError(
                f"A message has at most {limits.MAX_DEPTH} levels and {limits.MAX_ITEMS} items."
            )
        tag = self._take(1)[0]
        if tag < len(_CONSTANTS):
            return _CONSTANTS[tag]
        if tag - _SMALL_AT in _SMALL:
            return tag - _SMALL_AT
        if _BYTES <= tag <= _BYTES_LONGER:
            return self._take(self._size(tag, _BYTES))
        if _TUPLE <= tag <= _TUPLE_LONGER:
            size = self._size(tag, _TUPLE)
            if size > self.rest:  # each takes a byte at least
                raise MessageError("A message ends in the middle of a tuple.")
            return tuple(self.value(depth + 1) for _ in range(size))
        return self._other(tag, depth)

    def _other(self, tag: int, depth: int) -> Any:
        readers: dict[int, Callable[[], Any]] = {
            _TEXT: lambda: self._bytes(depth).decode(),
            _INT: lambda: int(self._take(self._number(1))),
            _INT_LONG: lambda: int(self._take(self._number(4))),
            _FLOAT: lambda: struct.unpack("!d", self._take(8))[0],
            _COMPLEX: lambda: struct.unpack("!dd", self._take(16)),
            _SLICE: lambda: self.value(depth + 1),
            _SET: lambda: self.value(depth + 1),
        }
        if tag not in readers:
            raise MessageError(f"A message of RPyC holds the unknown tag {tag}.")
        return readers[tag]()

    def _bytes(self, depth: int) -> bytes:
        data = self.value(depth + 1)
        if not isinstance(data, bytes):
            raise MessageError("A text of a message is no bytes.")
        return data

    def _size(self, tag: int, first: int) -> int:
        """The size of a thing whose tags begin with that for one byte or item."""
        few = tag - first
        return few + 1 if few < _FEW else self._number(1 if few == _FEW else 4)

    def _number(self, size: int) -> int:
        return int.from_bytes(self._take(size), "big")

    def _take(self, size: int) -> bytes:
        if size > self.rest:
            raise MessageError(f"A message ends {size - self.rest} bytes too early.")
        self._at += size
        return bytes(self._data[self._at - size : self._at])
