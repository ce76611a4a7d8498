"""MessagePack with NumPy arrays, as openpi's servers and clients write it.

An array is a map of `__ndarray__`, `data`, `dtype` and `shape`, and a NumPy scalar a map of
`__npgeneric__`, `data` and `dtype`, with keys of type bin. Keys of type str are read as well, and
written for servers that read no others.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import msgspec
import numpy as np

from duobench.errors import MessageError
from duobench.policy.serving import limits
from duobench.policy.serving.message_size import check_size

_ARRAY, _SCALAR = "__ndarray__", "__npgeneric__"
_DATA, _DTYPE, _SHAPE = "data", "dtype", "shape"
_PLAIN = (type(None), bool, int, float, str, bytes)
_DTYPE_TEXT = re.compile(rf"[<>|=]?[{limits.DTYPE_KINDS}]\d+")


def pack(message: Mapping[str, Any], *, is_text_keyed: bool = False) -> bytes:
    """A message as bytes.

    Args:
        message: Plain values and arrays, in maps and lists.
        is_text_keyed: Whether the keys of an array are of type str, not bin.

    Raises:
        MessageError: If it holds something that cannot be sent.
    """
    try:
        return msgspec.msgpack.encode(_packed(message, is_text_keyed=is_text_keyed))
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise MessageError(f"This cannot be sent: {error}.") from error


def unpack(data: bytes) -> dict[str, Any]:
    """A map from bytes that anybody may have sent; its arrays are copies, and writable.

    Raises:
        MessageError: If it is no map of texts to plain values and arrays, or beyond the limits.
    """
    message = read(data)
    if not isinstance(message, dict):
        raise MessageError(
            f"A message is a map of names to values, got a {type(message).__name__}."
        )
    return message


def read(data: bytes) -> Any:
    """A message of any type from bytes that anybody may have sent.

    Raises:
        MessageError: If it is none, or beyond the limits.
    """
    check_size(data)
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
        return {key: _packed(each, is_text_keyed=is_text_keyed) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_packed(each, is_text_keyed=is_text_keyed) for each in value]
    if type(value) in _PLAIN:
        return value
    for kind in (float, int, str, bytes):  # such as NumPy's float64, which is a float
        if isinstance(value, kind):
            return kind(value)  # pyright: ignore[reportArgumentType]
    if not isinstance(value, np.ndarray | np.generic) or value.dtype.kind not in limits.DTYPE_KINDS:
        kind = getattr(value, "dtype", type(value).__name__)
        raise TypeError(f"a message holds plain values and arrays of numbers or texts, not {kind}")
    fields: dict[str, Any] = {_DTYPE: value.dtype.str}
    if isinstance(value, np.generic):
        fields = {_SCALAR: True, _DATA: value.item(), **fields}
    else:
        fields = {_ARRAY: True, _DATA: value.tobytes(), **fields, _SHAPE: value.shape}
    return fields if is_text_keyed else {key.encode(): each for key, each in fields.items()}


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
    data, dtype, shape = fields[_DATA], _dtype(fields[_DTYPE]), fields[_SHAPE]
    if (
        not isinstance(shape, list)
        or len(shape) > limits.MAX_DIMENSIONS
        or not all(type(size) is int and size >= 0 for size in shape)
    ):
        raise MessageError(f"A shape has at most {limits.MAX_DIMENSIONS} sizes, got {shape!r:.80}.")
    if not isinstance(data, bytes) or math.prod(shape) * dtype.itemsize != len(data):
        size = len(data) if isinstance(data, bytes) else "no"
        raise MessageError(
            f"An array of shape {shape} and dtype {dtype.str} came with {size} bytes."
        )
    try:
        array = np.frombuffer(data, dtype).reshape(shape)
    except (ValueError, OverflowError) as error:  # no bytes at all, in a shape beyond all bounds
        raise MessageError(f"There is no array of shape {shape}.") from error
    return array.view(np.uint8) != 0 if dtype.kind == "b" else array.copy()


def _dtype(text: object) -> np.dtype[Any]:
    """A dtype by its name, such as "<f4", if arrays of it may be read."""
    if isinstance(text, str) and len(text) <= limits.MAX_DTYPE_TEXT and _DTYPE_TEXT.fullmatch(text):
        with suppress(TypeError):  # such as f3
            dtype: np.dtype[Any] = np.dtype(text)
            if dtype.itemsize:
                return dtype
    raise MessageError(f"Arrays of dtype {text!r:.40} are not read; <f4 and |u1 are, for example.")


def _scalar(fields: dict[str, Any]) -> np.generic:
    _expect(fields, _SCALAR, {_SCALAR, _DATA, _DTYPE})
    dtype, data = _dtype(fields[_DTYPE]), fields[_DATA]
    if not isinstance(data, _PLAIN[1:]):
        raise MessageError(f"A NumPy scalar is no {type(data).__name__}.")
    try:
        with np.errstate(all="ignore"):  # a number beyond its dtype is infinite
            return dtype.type(np.array(data).astype(dtype)[()])
    except (ValueError, TypeError, OverflowError) as error:
        raise MessageError(f"A NumPy scalar of {dtype} cannot be read: {error}.") from error


def _expect(fields: dict[str, Any], mark: str, names: set[str]) -> None:
    if fields.keys() != names or fields[mark] is not True:
        raise MessageError(f"A map with {mark} has exactly the keys {', '.join(sorted(names))}.")
