"""The options of a verb: its arguments, and the fields of those that are values of the library."""

from __future__ import annotations

import inspect
import shlex
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from typing import Annotated, get_args, get_origin, get_type_hints

_ELSEWHERE: Mapping[str, str] = {"out": "DIR", "server": "URL", "key_file": "FILE"}
"""What stands for a value that another machine has elsewhere, or that is nobody's business."""
_NO_MATTER = (
    *("workers", "retry_broken", "wait", "watch", "watch_port"),
    *("executor", "address", "policy_gpus", "shard"),
)
"""Options that no result depends on."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Option:
    """One option of a verb."""

    name: str
    """Its name in the code."""
    flag: str
    """Its name on the command line."""
    kind: object
    """The type that it takes, with annotations."""
    default: object
    """Its value where it is not given."""
    argument: str
    """The argument of the verb that has it: itself, or a data class of which it is a field."""
    is_nested: bool
    """Whether that is a data class."""

    def value(self, given: Mapping[str, object]) -> object:
        """Its value, out of those of the verb's arguments."""
        value = given[self.argument]
        return getattr(value, self.name) if self.is_nested else value


def options_of(verb: Callable[..., None]) -> Iterator[Option]:
    """The options of a verb; those of nested data classes have no prefix."""
    hints = get_type_hints(verb, include_extras=True)
    for name, parameter in inspect.signature(verb).parameters.items():
        kind = get_args(hints[name])[0] if get_origin(hints[name]) is Annotated else hints[name]
        if isinstance(kind, type) and is_dataclass(kind):
            inner = get_type_hints(kind, include_extras=True)
            for each in fields(kind):
                default = each.default if each.default is not MISSING else inspect.Parameter.empty
                yield _option(each.name, inner[each.name], default, name, is_nested=True)
        else:
            yield _option(name, hints[name], parameter.default, name, is_nested=False)


def _option(name: str, kind: object, default: object, argument: str, *, is_nested: bool) -> Option:
    marks = getattr(kind, "__metadata__", ())
    renamed = [mark.name for mark in marks if getattr(mark, "name", None)]
    flag = f"--{(renamed[0] if renamed else name).replace('_', '-')}"
    return Option(
        name=name,
        flag=flag,
        kind=kind,
        default=default,
        argument=argument,
        is_nested=is_nested,
    )


def command_line(verb: str, function: Callable[..., None], given: Mapping[str, object]) -> str:
    """The command that calls a verb, with every option that a result may depend on.

    Args:
        verb: Its name.
        function: The verb.
        given: Values of its arguments; an option at its default is left out.
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
