"""NumPy arrays from bytes, a dtype and a shape that anybody may have sent."""

from __future__ import annotations

import math
import re
from contextlib import suppress
from typing import Any

import numpy as np

from duobench.errors import MessageError
from duobench.policy.serving import limits

_DTYPE_TEXT = re.compile(rf"[<>|=]?[{limits.DTYPE_KINDS}]\d+")


def array_from(data: object, dtype: object, shape: object) -> np.ndarray:
    """An array, if its bytes are exactly as many as its shape and dtype say.

    Args:
        data: Its bytes in C order.
        dtype: The name of its dtype, such as "<f4".
        shape: A list of sizes.

    Returns:
        A copy of the bytes as an array, writable.

    Raises:
        MessageError: If one of them is of a wrong type, the dtype may not be read, or they
            contradict each other.
    """
    read = dtype_from(dtype)
    if (
        not isinstance(shape, list)
        or len(shape) > limits.MAX_DIMENSIONS
        or not all(type(size) is int and size >= 0 for size in shape)
    ):
        raise MessageError(f"A shape has at most {limits.MAX_DIMENSIONS} sizes, got {shape!r:.80}.")
    if not isinstance(data, bytes) or math.prod(shape) * read.itemsize != len(data):
        size = len(data) if isinstance(data, bytes) else "no"
        raise MessageError(
            f"An array of shape {shape} and dtype {read.str} came with {size} bytes."
        )
    try:
        array = np.frombuffer(data, read).reshape(shape)
    except (ValueError, OverflowError) as error:  # no bytes at all, in a shape beyond all bounds
        raise MessageError(f"There is no array of shape {shape}.") from error
    return array.view(np.uint8) != 0 if read.kind == "b" else array.copy()


def dtype_from(text: object) -> np.dtype[Any]:
    """A dtype by its name.

    Raises:
        MessageError: If there is none of that name, or arrays of it may not be read.
    """
    if isinstance(text, str) and len(text) <= limits.MAX_DTYPE_TEXT and _DTYPE_TEXT.fullmatch(text):
        with suppress(TypeError):  # such as f3
            dtype: np.dtype[Any] = np.dtype(text)
            if dtype.itemsize:
                return dtype
    raise MessageError(f"Arrays of dtype {text!r:.40} are not read; <f4 and |u1 are, for example.")
