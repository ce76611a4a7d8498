"""MessagePack with NumPy arrays, as openpi's servers and clients write it.

An array is a map of `__ndarray__`, `data`, `dtype` and `shape`, and a NumPy scalar a map of
`__npgeneric__`, `data` and `dtype`, with keys of type bin. Keys of type str are read as well, and
written for servers that read no others.
"""

import math
import re
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import msgspec
import numpy as np

from duobench.core.errors import MessageError
from duobench.policy.serving import limits

_ARRAY, _SCALAR = "__ndarray__", "__npgeneric__"
_DATA, _DTYPE, _SHAPE = "data", "dtype", "shape"
_PLAIN = (type(None), bool, int, float, str, bytes)
_DTYPE_TEXT = re.compile(rf"[<>|=]?[{limits.DTYPE_KINDS}]\d+")

_BINARY, _TEXT, _LIST, _MAP = "binary", "text", "array", "map"
_HEADS: Mapping[int, tuple[str, int, int]] = {
    **dict.fromkeys((*range(0x80), 0xC0, 0xC2, 0xC3, *range(0xE0, 0x100)), ("", 0, 0)),
    **{0x80 + length: (_MAP, 0, length) for length in range(0x10)},
    **{0x90 + length: (_LIST, 0, length) for length in range(0x10)},
    **{0xA0 + length: (_TEXT, 0, length) for length in range(0x20)},
    **{0xC4 + power: (_BINARY, 1 << power, 0) for power in range(3)},
    **dict.fromkeys((0xCC, 0xD0), ("", 0, 1)),
    **dict.fromkeys((0xCD, 0xD1), ("", 0, 2)),
    **dict.fromkeys((0xCA, 0xCE, 0xD2), ("", 0, 4)),
    **dict.fromkeys((0xCB, 0xCF, 0xD3), ("", 0, 8)),
    **{0xD9 + power: (_TEXT, 1 << power, 0) for power in range(3)},
    **{0xDC + power: (_LIST, 2 << power, 0) for power in range(2)},
    **{0xDE + power: (_MAP, 2 << power, 0) for power in range(2)},
}
"""By the first byte of a value: its kind, how many bytes after that say its length, and the length
where none do [MessagePack specification]."""
_MOST: Mapping[str, int] = {
    _BINARY: limits.MAX_REPLY,
    _TEXT: limits.MAX_TEXT,
    _LIST: limits.MAX_ARRAY_ITEMS,
    _MAP: limits.MAX_MAP_ITEMS,
}


def pack(message: Mapping[str, Any], *, is_text_keyed: bool = False) -> bytes:
    """A message of plain values and arrays, in maps and lists, as bytes; else a `MessageError`.

    The keys of an array are of type str if the message is text-keyed, else bin.
    """
    try:
        return msgspec.msgpack.encode(_packed(message, is_text_keyed=is_text_keyed))
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise MessageError(f"This cannot be sent: {error}.") from error


def unpack(data: bytes) -> dict[str, Any]:
    """Decode a map of names to values from untrusted bytes; its arrays are writable copies."""
    message = read(data)
    if not isinstance(message, dict):
        raise MessageError(
            f"A message is a map of names to values, got a {type(message).__name__}."
        )
    return message


def read(data: bytes) -> Any:
    """Decode a message of any type from untrusted bytes."""
    _check_size(data)
    try:
        message = msgspec.msgpack.decode(data)
    except (ValueError, TypeError, RecursionError) as error:
        raise MessageError(
            f"A message cannot be read: {str(error) or 'it is no MessagePack'}."
        ) from error
    return _checked(message, 0)


def _packed(value: object, *, is_text_keyed: bool) -> object:
    """A value in which arrays and scalars of NumPy are maps, as they are sent."""
    if isinstance(value, Mapping):
        return {
            key: _packed(each, is_text_keyed=is_text_keyed)
            for key, each in value.items()
        }
    if isinstance(value, list | tuple):
        return [_packed(each, is_text_keyed=is_text_keyed) for each in value]
    if type(value) in _PLAIN:
        return value
    for kind in (float, int, str, bytes):  # such as NumPy's float64, which is a float
        if isinstance(value, kind):
            return kind(value)  # pyright: ignore[reportArgumentType]
    if (
        not isinstance(value, np.ndarray | np.generic)
        or value.dtype.kind not in limits.DTYPE_KINDS
    ):
        kind = getattr(value, "dtype", type(value).__name__)
        raise TypeError(
            f"a message holds plain values and arrays of numbers or texts, not {kind}"
        )
    fields: dict[str, Any] = {_DTYPE: value.dtype.str}
    if isinstance(value, np.generic):
        fields = {_SCALAR: True, _DATA: value.item(), **fields}
    else:
        fields = {_ARRAY: True, _DATA: value.tobytes(), **fields, _SHAPE: value.shape}
    return (
        fields
        if is_text_keyed
        else {key.encode(): each for key, each in fields.items()}
    )


def _checked(value: Any, depth: int) -> Any:
    """A value with its arrays, if everything in it may be there."""
    if depth > limits.MAX_DEPTH:
        raise MessageError(f"A message is at most {limits.MAX_DEPTH} levels deep.")
    if isinstance(value, list):
        return [_checked(item, depth + 1) for item in value]
    if not isinstance(value, dict):
        if not isinstance(value, _PLAIN):
            raise MessageError(f"A message holds no {type(value).__name__}.")
        return value
    fields = {_text(key): item for key, item in value.items()}
    if _ARRAY in fields:
        return _array(fields)
    if _SCALAR in fields:
        return _scalar(fields)
    return {key: _checked(item, depth + 1) for key, item in fields.items()}


def _text(key: object) -> str:
    if isinstance(key, bytes):
        with suppress(UnicodeDecodeError):
            return key.decode()
    if not isinstance(key, str):
        raise MessageError("The keys of a map are texts.")
    return key


def _array(fields: dict[str, Any]) -> np.ndarray:
    """A writable array, if its bytes are exactly as many as its shape and dtype say."""
    _expect(fields, _ARRAY, {_ARRAY, _DATA, _DTYPE, _SHAPE})
    data = fields[_DATA]
    dtype = _dtype(fields[_DTYPE])
    shape = fields[_SHAPE]
    if (
        not isinstance(shape, list)
        or len(shape) > limits.MAX_DIMENSIONS
        or not all(type(size) is int and size >= 0 for size in shape)
    ):
        raise MessageError(
            f"A shape has at most {limits.MAX_DIMENSIONS} sizes, got {shape!r:.80}."
        )
    if not isinstance(data, bytes) or math.prod(shape) * dtype.itemsize != len(data):
        size = len(data) if isinstance(data, bytes) else "no"
        raise MessageError(
            f"An array of shape {shape} and dtype {dtype.str} came with {size} bytes."
        )
    try:
        array = np.frombuffer(data, dtype).reshape(shape)
    except (
        ValueError,
        OverflowError,
    ) as error:  # no bytes at all, in a shape beyond all bounds
        raise MessageError(f"There is no array of shape {shape}.") from error
    return array.view(np.uint8) != 0 if dtype.kind == "b" else array.copy()


def _dtype(text: object) -> np.dtype[Any]:
    """A dtype by its name, such as "<f4", if arrays of it may be read."""
    if (
        isinstance(text, str)
        and len(text) <= limits.MAX_DTYPE_TEXT
        and _DTYPE_TEXT.fullmatch(text)
    ):
        with suppress(TypeError):  # such as f3
            dtype: np.dtype[Any] = np.dtype(text)
            if dtype.itemsize:
                return dtype
    raise MessageError(
        f"Arrays of dtype {text!r:.40} are not read; <f4 and |u1 are, for example."
    )


def _scalar(fields: dict[str, Any]) -> np.generic:
    _expect(fields, _SCALAR, {_SCALAR, _DATA, _DTYPE})
    dtype, data = _dtype(fields[_DTYPE]), fields[_DATA]
    if not isinstance(data, _PLAIN[1:]):
        raise MessageError(f"A NumPy scalar is no {type(data).__name__}.")
    try:
        with np.errstate(all="ignore"):  # a number beyond its dtype is infinite
            return dtype.type(np.array(data).astype(dtype)[()])
    except (ValueError, TypeError, OverflowError) as error:
        raise MessageError(
            f"A NumPy scalar of {dtype} cannot be read: {error}."
        ) from error


def _expect(
    fields: dict[str, Any],
    mark: str,
    names: set[str],
) -> None:
    if fields.keys() != names or fields[mark] is not True:
        raise MessageError(
            f"A map with {mark} has exactly the keys {', '.join(sorted(names))}."
        )


def _check_size(data: bytes) -> None:
    """Reject a message that holds too much; one that is cut off passes, and cannot be decoded."""
    position = 0
    expected = 1
    items = 0
    while expected and position < len(data):
        first = data[position]
        position += 1
        expected -= 1
        items += 1
        if first not in _HEADS:
            raise MessageError(
                f"A message cannot be read: it holds a value of type {first:#04x}."
            )
        kind, size, length = _HEADS[first]
        length += int.from_bytes(data[position : position + size])
        position += size
        if length > _MOST.get(kind, length):
            raise MessageError(
                f"A message cannot be read: a {kind} has at most {_MOST[kind]} items."
            )
        if kind in (_LIST, _MAP):
            expected += length * (2 if kind == _MAP else 1)
        else:
            position += length
        if items + expected > limits.MAX_ITEMS:
            raise MessageError(f"A message holds at most {limits.MAX_ITEMS} items.")
