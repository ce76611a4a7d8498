"""The options of a reset: their names, and the check that they are some."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from difflib import get_close_matches
from typing import Any

from duobench.errors import OptionError, check_known, escaped
from duobench.types import as_whole

LAYOUT, LAYOUT_SEED, SPLIT, LOOK = "layout", "layout_seed", "split", "look"
INSTRUCTION = "instruction"
OF_SIMULATION = (LAYOUT, LAYOUT_SEED, SPLIT, LOOK, INSTRUCTION)
"""Options of a reset in simulation; see `SimEnv`."""


def checked_seed(seed: Any) -> int | None:
    """The seed of a reset as an integer; NumPy's integers are taken too.

    Raises:
        OptionError: It is no whole number, or negative.
    """
    if seed is None:
        return None
    number = as_whole(seed)
    if number is None or number < 0:
        raise OptionError(f"A seed is a whole number from 0 on, got {seed!r}.")
    return number


def checked_reset_options(options: Any, known: Collection[str] | None = None) -> dict[str, Any]:
    """The options of a reset as a new dict.

    Args:
        options: What was given.
        known: Names of our options; None leaves names to others.

    Raises:
        OptionError: They are no mapping.
        UnknownNameError: One is nearly an option of ours. Those of another name are left to the
            wrappers and programs around the environment, some of which hand on their own.
    """
    if options is not None and not isinstance(options, Mapping):
        raise OptionError(f"The options of a reset are a dict, got {options!r}.")
    if known is not None:
        for name in map(str, options or ()):
            if get_close_matches(name, known):
                check_known("option of a reset", name, known)
    return dict(options or {})


def checked_instruction(value: Any, count: int) -> int | str:
    """The instruction of an episode: text as it is told, or the number of one of the task's.

    Args:
        value: What was given; None takes the task's own, number 0.
        count: How many instructions the task has, paraphrases included.

    Raises:
        OptionError: It is neither text that can be printed nor one of the numbers.
    """
    if isinstance(value, str):
        if value.strip() and value == escaped(value):
            return value
        raise OptionError(f"An instruction is text that can be printed, got {value!a}.")
    number = 0 if value is None else as_whole(value)
    if number is None or not 0 <= number < count:
        raise OptionError(
            f"An instruction is text, or a number from 0 to {count - 1}: the task's own and its "
            f"paraphrases; got {value!r}."
        )
    return number
