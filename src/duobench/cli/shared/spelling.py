"""Misspelt verbs and options, words in place of numbers, and arguments that are missing."""

import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from difflib import get_close_matches
from types import NoneType, UnionType
from typing import Literal, get_args, get_origin, get_type_hints

from duobench.cli.shared.options import options_of
from duobench.errors import DuoBenchError

Verbs = Mapping[str, Callable[..., None]]
HELP = ("--help", "-h", "--version")
REST = "--"
"""What follows it is another program's."""
SYNONYMS = {"evaluate": "eval", "test": "eval", "teleoperate": "record", "visualize": "replay"}
"""What people type who know other programs."""
INSTEAD = {
    "camera cameras obs obs-mode": "A policy names its cameras: its metadata is "
    "PolicyMetadata(cameras=(...)).",
    "gpu gpus device cuda": "A policy chooses its device itself; with --executor ray there is "
    "--policy-gpus.",
    "headless render render-mode gui viewer": "No window is opened; duobench view shows tasks and "
    "runs.",
    "seed seeds": "Seeds follow from task and episode; duobench eval has --first-episode.",
    "model checkpoint ckpt weights pretrained": "A checkpoint of LeRobot is a policy: --policy "
    "lerobot:PATH.",
    "env environment env-id": "What is played is a task: --tasks bin_sort.",
    "resume continue": "The same command in the same folder goes on where it was stopped.",
    "horizon max-steps max-episode-steps": "The task fixes its horizon; --overtime 1.5 plays on.",
}
"""What to do in place of options that people know from other programs."""
_DEMOS, _RUN = "demos", "runs/expert"
EXAMPLES = {
    **dict.fromkeys(("view", "render", "print"), "bin_sort"),
    **dict.fromkeys(("report", "verify", "bundle"), _RUN),
    **dict.fromkeys(("replay", "data info", "data check", "data recover"), _DEMOS),
    "eval": f"--policy expert --out {_RUN}",
    "compare": f"{_RUN} runs/mine --out compared",
    "leaderboard": "bundles --out leaderboard",
    "salt": "salt.txt",
    "record": f"--tasks bin_sort --out {_DEMOS}",
    "teleop": f"carry_pot --out {_DEMOS}",
    "serve": "--policy my_policy:MyPolicy",
    "train": f"act --data {_DEMOS}-lerobot --out trained",
    "data merge": f"{_DEMOS} more --out merged",
    "data split": f"{_DEMOS} --fraction 0.8 --out train test",
    "export lerobot": f"{_DEMOS} --out {_DEMOS}-lerobot",
}
"""Arguments with which verbs work that need some; those of real arms have pages of their own."""
MANY = 12
"""Options of which not all are named in a message."""
NUMBERS = {int: "a whole number", float: "a number"}


class SpellingError(DuoBenchError):
    """A verb, an option or a number that is none."""


def check_spelling(words: Sequence[str], verbs: Verbs, program: str, default: str = "") -> None:
    """Find the first misspelt verb or option, or a word where a number should be.

    The program is called such as "duobench export"; `default` is the verb to propose where none is
    near, if there is only one sensible.
    """
    if not words:
        raise SpellingError(
            f"{program} needs a verb: {', '.join(verbs)}. {program} --help describes them."
        )
    if words[0] in HELP:
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
    _check_needed(rest, verbs[verb], f"{program} {verb}")


def _check_needed(words: Sequence[str], verb: Callable[..., None], program: str) -> None:
    """Find out which arguments are missing that have no default."""
    if any(word in HELP for word in words):
        return
    flags = {word.partition("=")[0].replace("_", "-") for word in words if word.startswith("--")}
    has_first = len(flags) < len(words)
    missing = [
        option.name.upper() if option.is_first else option.flag
        for option in options_of(verb)
        if option.default is inspect.Parameter.empty
        and not (has_first if option.is_first else option.flag in flags)
    ]
    if missing:
        example = EXAMPLES.get(program.removeprefix("duobench "))
        shown = f"{program} {example}" if example else f"{program} --help"
        raise SpellingError(f"{program} needs {' and '.join(missing)}; see: {shown}")


def _check_options(words: Sequence[str], verb: Callable[..., None], program: str) -> None:
    flags = _flags(verb)
    for at, word in enumerate(words):
        if word == REST:
            return
        name, _, joined = word.partition("=")
        if not name.startswith("--") or name in HELP:
            continue
        if name.replace("_", "-") not in flags:
            hint = _instead(name, flags, f"{program} --help")
            raise SpellingError(f"{program} has no option {name}. {hint}")
        kind = _number_of(flags[name.replace("_", "-")])
        value = joined or (words[at + 1] if at + 1 < len(words) else "")
        if kind in NUMBERS and not _is_a(kind, value):
            raise SpellingError(f"{name} takes {NUMBERS[kind]}, not {value!r}.")


def _instead(name: str, flags: Collection[str], help_of: str) -> str:
    """What to do in place of an option that there is not."""
    plain = name.removeprefix("--").replace("_", "-")
    known = [text for others, text in INSTEAD.items() if plain in others.split()]
    if known and not any(flag.startswith(name) for flag in flags):
        return known[0]
    if near := _near(name, flags):
        return f"Did you mean {near}?"
    return f"There are: {', '.join(flags)}." if len(flags) < MANY else f"{help_of} lists them."


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
