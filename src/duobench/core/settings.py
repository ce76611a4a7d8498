"""Reads settings without letting a mistake pass: known keys alone, each of them once."""

import json
import math
from collections.abc import Mapping
from dataclasses import is_dataclass
from enum import EnumType
from types import NoneType
from typing import (
    Any,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

import msgspec

from duobench.core.errors import OptionError, check_known

T = TypeVar("T")


def parse(text: str) -> dict[str, Any]:
    """Parse the JSON object in a text.

    Raises:
        ValueError: The text is no JSON object, a key stands twice in one place, or a number is not
            finite.
    """
    document = json.loads(
        text,
        object_pairs_hook=_with_keys_once,
        parse_float=_finite,
        parse_constant=_finite,
    )
    return _keys_of(document, "the file")


def decode(
    document: Any,
    kind: type[T],
    where: str = "",
) -> T:
    """An instance of a data class from an object's keys, with those of its fields likewise.

    Args:
        document: What `parse` gave.
        kind: The data class.
        where: Where in the file the object stands, such as "arms.left"; or what it is.

    Raises:
        OptionError: A value has the wrong type, or a value that the class does not take.
        UnknownNameError: There is no such key; the message names those that are near.
    """
    hints, fields = get_type_hints(kind), _keys_of(document, where or "the file")
    for name, value in fields.items():
        check_known(f"key of {where or 'the file'}", name, hints)
        fields[name] = _decoded(value, hints[name], f"{where}.{name}".lstrip("."))
    try:
        return msgspec.convert(fields, kind)
    except msgspec.ValidationError as error:
        text, _, inside = str(error).partition(" - at `$")
        place = f"{where}{inside.rstrip('`')}".lstrip(".")
        raise OptionError(f"{place}: {text}" if place else text) from error


def _decoded(
    value: Any,
    hint: Any,
    where: str,
) -> Any:
    kinds = [each for each in get_args(hint) or (hint,) if each is not NoneType]
    if get_origin(hint) is Mapping:
        names, kind = kinds
        for name in _keys_of(value, where) if isinstance(names, EnumType) else ():
            check_known(f"key of {where}", name, [str(each) for each in names])
        return {
            name: decode(each, kind, f"{where}.{name}")
            for name, each in _keys_of(value, where).items()
        }
    if isinstance(hint, EnumType):
        check_known(where, value, [str(each) for each in hint])
    row = next((each for each in (hint, *kinds) if get_origin(each) is tuple), None)
    if row is not None and isinstance(value, list | tuple):
        kind = get_args(row)[0]
        return [
            _decoded(one, kind, f"{where}[{number}]")
            for number, one in enumerate(value)
        ]
    if row is None and is_dataclass(kinds[0]) and value is not None:
        return decode(value, kinds[0], where)  # type: ignore[arg-type] - a class, no instance
    return value


def _keys_of(document: Any, where: str) -> dict[str, Any]:
    if not isinstance(document, dict):
        raise OptionError(
            f"{where} is an object, with keys in braces; got {document!r:.40}."
        )
    return dict(document)


def _with_keys_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    document = dict(pairs)
    if len(document) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise OptionError(
            f"The key {twice!r} stands twice in one place; keep one of them."
        )
    return document


def _finite(text: str) -> float:
    if not math.isfinite(number := float(text)):
        raise OptionError(f"Numbers are finite, got {text}.")
    return number
