"""The options of a verb: its arguments, and the fields of those that are values of the library."""

import inspect
import shlex
from collections.abc import Callable, Iterator, Mapping
from dataclasses import (
    MISSING,
    dataclass,
    fields,
    is_dataclass,
)
from typing import (
    Annotated,
    get_args,
    get_origin,
    get_type_hints,
)

_ELSEWHERE: Mapping[str, str] = {
    "out": "DIR",
    "server": "URL",
    "key_file": "FILE",
}
"""Placeholders of values that another machine has elsewhere, or that are private."""
_NO_MATTER = (
    "workers",
    "observer",
    "retry_broken",
    "wait",
    "executor",
    "address",
    "policy_gpus",
    "shard",
)
"""Options that no result depends on."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Option:
    """One option of a verb: its name in the code, and the type with annotations that it takes."""

    name: str
    kind: object
    default: object
    argument: str
    """The argument of the verb that has it: itself, or a data class of which it is a field."""
    is_nested: bool
    """Whether that is a data class."""

    @property
    def is_first(self) -> bool:
        """Whether it stands without a name, before the named ones."""
        return "Positional" in str(self.kind)

    @property
    def flag(self) -> str:
        """Its name on the command line."""
        marks = getattr(self.kind, "__metadata__", ())
        renamed = (mark.name for mark in marks if getattr(mark, "name", None))
        return f"--{next(renamed, self.name).replace('_', '-')}"

    def value(self, given: Mapping[str, object]) -> object:
        """Its value, out of those of the verb's arguments."""
        value = given[self.argument]
        return getattr(value, self.name) if self.is_nested else value


def options_of(verb: Callable[..., None]) -> Iterator[Option]:
    """The options of a verb; those of nested data classes have no prefix."""
    hints = get_type_hints(verb, include_extras=True)
    for name, parameter in inspect.signature(verb).parameters.items():
        kind = (
            get_args(hints[name])[0]
            if get_origin(hints[name]) is Annotated
            else hints[name]
        )
        if isinstance(kind, type) and is_dataclass(kind):
            inner = get_type_hints(kind, include_extras=True)
            for each in fields(kind):
                default = (
                    each.default
                    if each.default is not MISSING
                    else inspect.Parameter.empty
                )
                yield Option(
                    name=each.name,
                    kind=inner[each.name],
                    default=default,
                    argument=name,
                    is_nested=True,
                )
        else:
            yield Option(
                name=name,
                kind=hints[name],
                default=parameter.default,
                argument=name,
                is_nested=False,
            )


def command_line(
    verb: str, function: Callable[..., None], given: Mapping[str, object]
) -> str:
    """The command that calls a verb with some arguments, but for options at their defaults.

    It has every other option that a result may depend on.
    """
    words = ["duobench", verb]
    for option in options_of(function):
        value = option.value(given)
        if option.name in _NO_MATTER or value == option.default:
            continue
        if "UseAppendAction" in str(option.kind) and isinstance(value, tuple):
            words += [word for each in value for word in (option.flag, str(each))]
            continue
        words.append(option.flag)
        if option.name in _ELSEWHERE:
            words.append(_ELSEWHERE[option.name])
        elif isinstance(value, tuple):
            words += map(str, value)
        elif value is not True:
            words.append(str(value))
    return shlex.join(words)
