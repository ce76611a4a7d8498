"""Messages of VLAgents 0.3: observations and chunks of actions as JSON, with arrays in base64.

An array is a map of `__numpy__`, `dtype` and `shape`, as the package json-numpy writes it.
"""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from duobench.errors import MessageError, PolicyError
from duobench.policy.serving.arrays import array_from
from duobench.types import SIDES, Array, real_array

_ARRAY, _DTYPE, _SHAPE = "__numpy__", "dtype", "shape"


def observation_text(message: Mapping[str, Any]) -> str:
    """An observation as text.

    Args:
        message: Maps, texts, numbers and arrays.

    Raises:
        MessageError: If it holds something else.
    """
    try:
        return json.dumps(message, default=_packed)
    except (TypeError, ValueError) as error:
        raise MessageError(f"This cannot be sent: {error}.") from error


def actions_from(text: object) -> Array:
    """The actions in an answer that anybody may have sent.

    Args:
        text: The answer.

    Returns:
        Actions (H, n): numbers of the left arm, left gripper, numbers of the right arm, right
        gripper. They may be infinite, or not numbers.

    Raises:
        MessageError: If it is no JSON, or an array in it cannot be read.
        PolicyError: If it holds no actions of two arms.
    """
    if not isinstance(text, str):
        raise MessageError(f"An answer is a text, got a {type(text).__name__}.")
    try:
        answer = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MessageError(f"An answer is no JSON: {error!s:.200}.") from error
    acts = answer.get("acts") if isinstance(answer, dict) else None
    if not isinstance(acts, list) or not acts:
        raise PolicyError("The policy's server answers without any `acts`.")
    rows = [action_from(act) for act in acts]
    if len({len(row) for row in rows}) > 1:
        raise PolicyError("The policy's server answers with actions of different lengths.")
    return np.stack(rows)


def action_from(act: object) -> Array:
    """One action (n,) of both arms, from a map of their `action` and `gripper`.

    Raises:
        PolicyError: If an arm has none, or they are no numbers, or not as many in each arm.
    """
    parts = [_arm(act, str(side)) for side in SIDES]
    left, right = (len(part) for part in parts)
    if left != right:
        raise PolicyError(
            f"The policy's server gives the left arm {left} numbers and the right one {right}, the "
            "opening included."
        )
    return np.concatenate(parts)


def _packed(value: object) -> dict[str, Any]:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf":
        raise TypeError(
            f"an observation holds plain values and arrays of numbers, not {value!r:.80}"
        )
    data = base64.b64encode(value.tobytes()).decode()
    return {_ARRAY: data, _DTYPE: value.dtype.str, _SHAPE: value.shape}


def _arm(act: object, side: str) -> Array:
    """The numbers of an arm and the opening of its gripper."""
    arm = act.get(side) if isinstance(act, dict) else None
    if not isinstance(arm, dict) or arm.get("action") is None or arm.get("gripper") is None:
        known = ", ".join(sorted(act)) if isinstance(act, dict) else "nothing"
        raise PolicyError(
            "Each act of an answer has the arms `left` and `right`, each with an `action` and the "
            f"opening of its `gripper`; {side} has not. There is: {known[:200] or 'nothing'}."
        )
    action, gripper = _numbers(arm["action"], 1), _numbers(arm["gripper"], 0)
    return np.append(action, gripper)


def _numbers(value: object, dimensions: int) -> Array:
    """An array of numbers, or a number where there are no dimensions."""
    if isinstance(value, dict):
        value = _array(value)
    try:
        numbers = real_array(value, np.float64)  # pyright: ignore[reportArgumentType] - it is tried
    except (TypeError, ValueError, OverflowError) as error:
        raise PolicyError(f"The policy's server gives no numbers: {value!r:.80}.") from error
    if numbers.ndim != dimensions and not (dimensions == 0 and numbers.size == 1):
        raise PolicyError(
            "An `action` is a list of numbers and a `gripper` is one number, got an array of shape "
            f"{numbers.shape}."
        )
    return numbers


def _array(fields: dict[str, Any]) -> np.ndarray:
    if fields.keys() != {_ARRAY, _DTYPE, _SHAPE} or not isinstance(fields[_ARRAY], str):
        raise MessageError(f"An array has the keys {_ARRAY}, {_DTYPE} and {_SHAPE}.")
    try:
        data = base64.b64decode(fields[_ARRAY], validate=True)
    except (binascii.Error, ValueError) as error:
        raise MessageError(f"An array is no base64: {error}.") from error
    return array_from(data, fields[_DTYPE], fields[_SHAPE])
