"""All commands, and how their arguments are read."""

import sys
from collections.abc import Callable, Sequence
from functools import partial, wraps
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import tyro

from duobench.cli.shared.cameras import REGISTRY
from duobench.cli.shared.console import say
from duobench.cli.shared.options import options_of
from duobench.cli.shared.process import find_scratch
from duobench.cli.shared.spelling import hints, meant_command
from duobench.core.errors import DuoBenchError
from duobench.core.versions import __version__

DESCRIPTION = (
    "A benchmark for two-armed manipulation on the Franka FR3 Duo. "
    "duobench --version shows the version; with --verbose a command also says what it "
    "finds, such as what renders."
)

COMMANDS = (
    "eval",
    "report",
    "compare",
    "verify",
    "bundle",
    "record",
    "replay",
    "view",
    "teleop",
    "list",
    "render",
    "serve",
    "data info",
    "data check",
    "data card",
    "data recover",
    "data merge",
    "data split",
    "export lerobot",
    "train",
    "print",
    "real doctor",
    "real home",
    "real grippers",
    "real calibrate board",
    "real calibrate lens",
    "real calibrate head",
    "real calibrate wrist",
    "real calibrate gripper",
    "real rig check",
    "real record",
    "real eval",
    "real teleop",
    "doctor",
)
"""Commands, in the order of the help; each is the function `run` of the module of its name."""
HELP = ("--help", "-h")
TASKS = "--tasks"
CONFIG = (tyro.conf.EnumChoicesFromValues,)


class CommandError(DuoBenchError):
    """Unknown command, or an option without its value."""


def run(words: Sequence[str]) -> None:
    """Read the arguments and run the command that they name."""
    if words == ["--version"]:
        say(f"duobench {__version__}")
        return
    call = parsed(words)
    given = (*call.args, *call.keywords.values())
    find_scratch(path for path in given if isinstance(path, Path))
    call()


def function_of(command: str) -> Callable[..., None]:
    """Return the function of a command, whose module is imported now."""
    return _module_of(command).run


def names_in(group: str) -> list[str]:
    """Return the first words of the commands in a group, such as "data"; "" has all of them."""
    start = f"{group} ".lstrip()
    inside = [name.removeprefix(start) for name in COMMANDS if name.startswith(start)]
    return list(dict.fromkeys(name.partition(" ")[0] for name in inside))


def parsed(words: Sequence[str]) -> partial[None]:
    """Return the call of the command that the arguments name.

    Raises:
        CommandError: Unknown command.
        SystemExit: Help was shown, or tyro has told what is wrong with the arguments.
    """
    group = ""
    while words and words[0] in names_in(group):
        group = f"{group} {words[0]}".lstrip()
        words = words[1:]
        if group in COMMANDS:
            return _call(function_of(group), f"duobench {group}", words)
    names = names_in(group)
    program = f"duobench {group}".rstrip()
    if words and words[0] not in HELP:
        hint = meant_command(words[0], program, names)
        raise CommandError(f"{program} has no command {words[0]!r}. {hint}")
    return tyro.extras.subcommand_cli_from_dict(
        {name: _summary(f"{group} {name}".lstrip()) for name in names},
        prog=program,
        description=_module_of(group).__doc__ if group else DESCRIPTION,
        args=words,
    )


def _module_of(command: str) -> Any:
    return import_module(f"duobench.cli.{command.replace(' ', '.')}")


def _call(
    function: Callable[..., None], program: str, words: Sequence[str]
) -> partial[None]:
    @wraps(function)
    def call(*args: object, **options: object) -> partial[None]:
        return partial(function, *args, **options)

    for word, value in pairwise([*words, "--"]):
        if word == TASKS and value.startswith("--"):
            raise CommandError(f"{TASKS} needs a task; without it all are meant.")
    try:
        return tyro.cli(
            call,
            prog=program,
            args=words,
            config=CONFIG,
            registry=REGISTRY,
        )
    except SystemExit as left:
        if left.code:
            for hint in hints(words, [option.flag for option in options_of(function)]):
                sys.stderr.write(f"{hint}\n")
        raise


def _summary(name: str) -> Callable[[], partial[None]]:
    """Return a stand-in for a command or a group, with the first line of its description."""
    described = function_of(name) if name in COMMANDS else _module_of(name)

    def summary() -> partial[None]:
        return partial(run, name.split())

    summary.__doc__ = (described.__doc__ or "").partition("\n")[0]
    return summary
