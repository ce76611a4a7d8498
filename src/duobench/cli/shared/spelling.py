"""Words of a command that are misspelt, or missing, told before anything large is loaded."""

import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from types import NoneType, UnionType
from typing import Literal, get_args, get_origin, get_type_hints

from duobench.cli.shared.options import options_of
from duobench.core.errors import DuoBenchError, PolicyError, check_known
from duobench.tasks import catalog

Verbs = Mapping[str, Callable[..., None]]
HELP = ("--help", "-h", "--version")
REST = "--"
"""What follows it is another program's."""
SYNONYMS = {
    **dict.fromkeys(("evaluate", "test", "run", "rollout", "benchmark"), "eval"),
    **dict.fromkeys(("teleoperate", "collect", "generate"), "record"),
    **{"visualize": "replay", "help": "--help", "version": "--version", "-v": "--version"},
}
"""What people type who know other programs."""
INSTEAD = {
    "camera cameras obs": "Cameras are named by the policy: PolicyMetadata(cameras=(...)).",
    "gpu gpus device cuda": "A policy chooses its device itself; on Ray there is --policy-gpus.",
    "headless render gui viewer": "No window is opened; duobench view shows tasks and runs.",
    "seed seeds": "Seeds follow from task and episode; duobench eval has --first-episode.",
    "model checkpoint ckpt": "A checkpoint of LeRobot is a policy: --policy lerobot:PATH.",
    "env environment": "What is played is a task: --tasks bin_sort.",
    "num-envs n-envs num-processes": "Episodes are played side by side by --workers 4.",
    "resume continue": "The same command in the same folder goes on where it was stopped.",
    "horizon max-steps": "The task fixes its horizon; duobench eval --overtime 1.5 plays on.",
    "batch-size lr": "Options of lerobot-train come last, after --: -- --batch_size=8.",
    "format": "duobench export lerobot writes LeRobot's format.",
}
"""What to do in place of options that people know from other programs."""
EXAMPLES = {
    **dict.fromkeys(("view", "render", "print"), "bin_sort"),
    **dict.fromkeys(("report", "verify", "bundle"), "runs/expert"),
    **dict.fromkeys(("replay", "data info", "data check", "data recover"), "demos"),
    "eval": "--policy expert --out runs/expert",
    "compare": "runs/expert runs/mine --out compared",
    "record": "--tasks bin_sort --out demos",
    "teleop": "transfer_cube --out people",
    "serve": "--policy my_policy:MyPolicy",
    "export lerobot": "demos --out demos-lerobot",
    "train": "act --data demos-lerobot --out trained",
}
"""Arguments with which verbs of the first hours work."""
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
        near = near if near in verbs or near in HELP else ""
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
    room = len(words) if any(option.is_first for option in options_of(verb)) else 0
    for at, word in enumerate(words):
        if word == REST:
            return
        name, _, joined = word.partition("=")
        if not name.startswith("-") and (room := room - 1) < 0:
            flag = "--policy" if ":" in word and "--policy" in flags else "--tasks"
            hint = f" Did you mean {flag} {word}?" if flag in flags else ""
            raise SpellingError(f"{program} takes no {word!r} without an option.{hint}")
        if not name.startswith("--") or name in HELP:
            continue
        if name.replace("_", "-") not in flags:
            hint = _instead(name, flags, f"{program} --help")
            raise SpellingError(f"{program} has no option {name}. {hint}")
        kind = _number_of(flags[name.replace("_", "-")])
        room += len(words) if "tuple" in str(kind) else not joined
        value = joined or next(iter(words[at + 1 :]), "")
        taken = kind in {str, Path} or name == "--tasks"  # none would be all of them
        if taken and "=" not in word and (at + 1 == len(words) or value in flags):
            raise SpellingError(f"{name} is followed by what it takes, such as {name} NAME.")
        if kind in NUMBERS and not _is_a(kind, value):
            raise SpellingError(f"{name} takes {NUMBERS[kind]}, not {value!r}.")


def _instead(name: str, flags: Collection[str], help_of: str) -> str:
    """What to do in place of an option that there is not."""
    plain = name.removeprefix("--").replace("_", "-")
    known = [text for others, text in INSTEAD.items() if plain in others.split()]
    if known and not any(flag.startswith(name) for flag in flags):
        return known[0]
    near = _near(name, flags)
    if near:
        return f"Did you mean {near}?"
    return f"There are: {', '.join(flags)}." if 0 < len(flags) < MANY else f"{help_of} lists them."


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


TRAINED = ("act", "diffusion", "groot", "pi05", "smolvla", "xvla")
"""Kinds of policies, which people take for the name of one."""
FIRST = ""
"""Stands for the first argument of a verb, where that is no option."""
_OF_SCENE = {FIRST: "task", "--look": "look"}
NAMED: Mapping[str, Mapping[str, str]] = {
    "eval": {"--tasks": "task", "--policy": "policy", "--suite": "suite", "--look": "look"},
    "record": {"--tasks": "task", "--policy": "policy"},
    **dict.fromkeys(("render", "teleop", "view"), _OF_SCENE),
    "replay": {"--look": "look"},
    "serve": {"--policy": "policy"},
}
"""Which arguments of a verb are names, and of what."""


def check_names(words: Sequence[str]) -> None:
    """Reject the first name among the arguments that stands for nothing.

    Paths of modules are left to the verbs, which import them.

    Raises:
        DuoBenchError: There is no task, policy, suite or look of a name.
    """
    verb, *rest = words or [""]
    kinds, option = NAMED.get(verb, {}), FIRST
    if "--follow" in rest:  # a run that may not be there yet
        return
    for word in rest:
        value = word
        if word.startswith("--"):
            option, _, value = word.partition("=")
        kind = kinds.get(option, "")
        if value:
            _check(kind, value)
            option = option if kind == "task" else "-"  # of tasks there may be several


def _check(kind: str, word: str) -> None:
    if kind == "task" and not Path(word).exists():  # which `view` shows
        catalog.check(word)
    elif kind == "policy" and word in TRAINED:
        raise PolicyError(f"A trained {word} is lerobot:PATH; duobench train {word} trains one.")
    elif kind == "policy":
        from duobench.policy.registry import PolicyName
        from duobench.policy.serving.address import WORDS

        PolicyName.parse(word, WORDS)
    elif kind == "suite":
        from duobench.results.suite import SUITES

        check_known(kind, word, SUITES)
    elif kind == "look":
        from duobench.world.looks.catalog import look

        look(word)
