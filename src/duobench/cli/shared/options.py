"""The options of a verb: its arguments, and the fields of those that are values of the library."""

import inspect
import shlex
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from difflib import get_close_matches
from types import NoneType, UnionType
from typing import Annotated, Literal, get_args, get_origin, get_type_hints

from duobench.errors import DuoBenchError

_ELSEWHERE: Mapping[str, str] = {"out": "DIR", "server": "URL", "key_file": "FILE", "salt": "FILE"}
"""What stands for a value that another machine has elsewhere, or that is nobody's business."""
_NO_MATTER = (
    *("workers", "retry_broken", "wait", "watch", "watch_port"),
    *("executor", "address", "policy_gpus", "shard"),
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
        kind = get_args(hints[name])[0] if get_origin(hints[name]) is Annotated else hints[name]
        if isinstance(kind, type) and is_dataclass(kind):
            inner = get_type_hints(kind, include_extras=True)
            for each in fields(kind):
                default = each.default if each.default is not MISSING else inspect.Parameter.empty
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


def command_line(verb: str, function: Callable[..., None], given: Mapping[str, object]) -> str:
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


Verbs = Mapping[str, Callable[..., None]]
HELP = ("--help", "-h", "--version")
REST = "--"
"""What follows it is another program's."""
SYNONYMS = {"evaluate": "eval", "test": "eval", "teleoperate": "record", "visualize": "replay"}
"""What people type who know other programs."""
NUMBERS = {int: "a whole number", float: "a number"}


class SpellingError(DuoBenchError):
    """A verb, an option or a number that is none."""


def check_spelling(words: Sequence[str], verbs: Verbs, program: str, default: str = "") -> None:
    """Find the first misspelt verb or option, or a word where a number should be.

    The program is called such as "duobench export"; `default` is the verb to propose where none is
    near, if there is only one sensible.
    """
    if not words or words[0] in HELP:
        return
    verb, *rest = words
    if verb not in verbs:
        near = SYNONYMS.get(verb, "") or _near(verb, verbs)
        near = near if near in verbs else ""
        meant = f"{program} {near}" if near else f"{program} {default} {verb}" if default else ""
        hint = f"Did you mean `{meant}`?" if meant else f"There are: {', '.join(verbs)}."
        raise SpellingError(f"{program} has no verb {verb!r}. {hint}")
    _check_choice(rest, verbs[verb], f"{program} {verb}")
    _check_options(rest, verbs[verb], f"{program} {verb}")


def _check_options(words: Sequence[str], verb: Callable[..., None], program: str) -> None:
    flags = _flags(verb)
    for at, word in enumerate(words):
        if word == REST:
            return
        name, _, joined = word.partition("=")
        if not name.startswith("--") or name in HELP:
            continue
        if name.replace("_", "-") not in flags:
            near = _near(name, flags)
            hint = f"Did you mean {near}?" if near else f"There are: {', '.join(flags)}."
            raise SpellingError(f"{program} has no option {name}. {hint}")
        kind = _number_of(flags[name.replace("_", "-")])
        value = joined or (words[at + 1] if at + 1 < len(words) else "")
        if kind in NUMBERS and not _is_a(kind, value):
            raise SpellingError(f"{name} takes {NUMBERS[kind]}, not {value!r}.")


def _flags(verb: Callable[..., None]) -> dict[str, object]:
    """The options of a verb and what they take; those that are switched have a second form."""
    flags: dict[str, object] = {}
    for option in options_of(verb):
        flags[option.flag] = option.kind
        if option.kind is bool or bool in get_args(option.kind):
            flags[f"--no-{option.flag[2:]}"] = option.kind
    return flags


def _check_choice(words: Sequence[str], verb: Callable[..., None], program: str) -> None:
    """Find out whether the first word is one of a few, where a verb takes one of a few."""
    name, kind = next(iter(get_type_hints(verb, include_extras=True).items()), ("", None))
    choices = get_args(next(iter(get_args(kind)), None))
    is_literal = get_origin(next(iter(get_args(kind)), None)) is Literal
    if is_literal and words and not words[0].startswith("-") and words[0] not in choices:
        raise SpellingError(
            f"{program} takes {', '.join(choices[:-1])} or {choices[-1]} as {name}, not "
            f"{words[0]!r}."
        )


def _number_of(kind: object) -> object:
    """What an option takes, without None where that is its default alone."""
    if isinstance(kind, UnionType) and len(others := set(get_args(kind)) - {NoneType}) == 1:
        return others.pop()
    return kind


def _is_a(kind: object, value: str) -> bool:
    try:
        int(value) if kind is int else float(value)
    except ValueError:
        return False
    return True


def _near(word: str, known: Collection[str]) -> str:
    longer = [name for name in known if name.startswith(word)]
    return next(iter([*longer, *get_close_matches(word, known, n=1)]), "")
