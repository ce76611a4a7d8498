"""How much a MessagePack message would hold, found out before any of it is made."""

from __future__ import annotations

from collections.abc import Mapping

from duobench.errors import MessageError
from duobench.policy.serving import limits

_FIXED: Mapping[int, int] = {
    **dict.fromkeys((0xC0, 0xC2, 0xC3), 0),
    **dict.fromkeys((0xCC, 0xD0), 1),
    **dict.fromkeys((0xCD, 0xD1), 2),
    **dict.fromkeys((0xCA, 0xCE, 0xD2), 4),
    **dict.fromkeys((0xCB, 0xCF, 0xD3), 8),
}
"""Bytes after the first one of values of a fixed length [MessagePack specification]."""
_BINARY, _TEXT, _ARRAY, _MAP = "binary", "text", "array", "map"
_SIZED: Mapping[int, tuple[str, int]] = {
    **{0xC4 + power: (_BINARY, 1 << power) for power in range(3)},
    **{0xD9 + power: (_TEXT, 1 << power) for power in range(3)},
    **{0xDC + power: (_ARRAY, 2 << power) for power in range(2)},
    **{0xDE + power: (_MAP, 2 << power) for power in range(2)},
}
"""What begins with a byte, and how many bytes its length takes."""
_SHORT = ((0x80, 0x0F, _MAP), (0x90, 0x0F, _ARRAY), (0xA0, 0x1F, _TEXT))
"""First byte, mask of the length in it, and kind of short ones."""
_MOST: Mapping[str, int] = {
    _BINARY: limits.MAX_REPLY,
    _TEXT: limits.MAX_TEXT,
    _ARRAY: limits.MAX_ARRAY_ITEMS,
    _MAP: limits.MAX_MAP_ITEMS,
}


def check_size(data: bytes) -> None:
    """Reject a message that holds too much, or something of a kind that is not read.

    One that is cut off passes: whoever reads it finds that out.

    Raises:
        MessageError: It does.
    """
    position, expected, items = 0, 1, 0
    while expected and position < len(data):
        first = data[position]
        position += 1
        expected -= 1
        items += 1
        kind, length, position = _length(data, first, position)
        if length > _MOST.get(kind, length):
            raise MessageError(
                f"A message cannot be read: a {kind} has at most {_MOST[kind]} items."
            )
        if kind in (_ARRAY, _MAP):
            expected += length * (2 if kind == _MAP else 1)
        else:
            position += length
        if items + expected > limits.MAX_ITEMS:
            raise MessageError(f"A message holds at most {limits.MAX_ITEMS} items.")


def _length(data: bytes, first: int, position: int) -> tuple[str, int, int]:
    """Kind and length of a value, and where what belongs to it begins."""
    if first < 0x80 or first >= 0xE0:  # noqa: PLR2004 - small numbers [MessagePack specification]
        return "", 0, position
    if first in _FIXED:
        return "", _FIXED[first], position
    if first in _SIZED:
        kind, size = _SIZED[first]
        return kind, int.from_bytes(data[position : position + size]), position + size
    for start, mask, kind in _SHORT:
        if first & ~mask == start:
            return kind, first & mask, position
    raise MessageError(f"A message cannot be read: it holds a value of type {first:#04x}.")
