"""All verbs, and how their arguments are read."""

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial, wraps
from itertools import pairwise
from pathlib import Path

import tyro

from duobench.cli.real import arms, calibrate, check
from duobench.cli.shared.console import say
from duobench.cli.shared.options import options_of
from duobench.cli.shared.process import find_scratch
from duobench.cli.shared.spelling import hints, meant_command
from duobench.cli.verbs import (
    data,
    doctor,
    episodes,
    policies,
    runs,
    tasks,
    teleop,
)
from duobench.core.errors import DuoBenchError
from duobench.core.versions import __version__

DESCRIPTION = (
    "A benchmark for two-armed manipulation on the Franka FR3 Duo. "
    "duobench --version shows the version; with --verbose a verb also says what it finds, such as "
    "what renders."
)

VERBS: Mapping[str, Callable[..., None]] = {
    "eval": episodes.evaluate,
    "report": runs.report,
    "compare": runs.compare,
    "verify": runs.verify,
    "bundle": runs.bundle,
    "record": episodes.record,
    "replay": episodes.replay,
    "view": tasks.view,
    "teleop": teleop.teleop,
    "list": tasks.list_tasks,
    "render": tasks.render,
    "serve": policies.serve,
    "data": data.data,
    "export": data.export,
    "train": policies.train,
    "print": tasks.print_,
    "real": arms.real,
    "doctor": doctor.doctor,
}
GROUPS: Mapping[str, Mapping[str, Callable[..., None]]] = {
    "data": {
        "info": data.info,
        "check": data.check,
        "card": data.card,
        "recover": data.recover,
        "merge": data.merge,
        "split": data.split,
    },
    "export": {"lerobot": data.lerobot},
    "real": {
        "doctor": doctor.examine_rig,
        "home": arms.home,
        "grippers": arms.grippers,
        "calibrate": calibrate.calibrate,
        "rig": check.rig,
        "record": arms.record,
        "eval": arms.evaluate,
        "teleop": teleop.teleop_rig,
    },
    "real rig": {"check": check.check},
    "real calibrate": {
        "board": calibrate.board,
        "lens": calibrate.lens,
        "head": calibrate.head,
        "wrist": calibrate.wrist,
        "gripper": calibrate.gripper,
    },
}
"""Verbs that have verbs of their own."""
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


def parsed(words: Sequence[str]) -> partial[None]:
    """Return the call of the command that the arguments name.

    Raises:
        CommandError: Unknown command.
        SystemExit: Help was shown, or tyro has told what is wrong with the arguments.
    """
    verbs, program, description = VERBS, "duobench", DESCRIPTION
    while words and words[0] in verbs:
        name, *words = words
        program = f"{program} {name}"
        group = program.removeprefix("duobench ")
        if group not in GROUPS:
            return _call(verbs[name], program, words)
        verbs, description = GROUPS[group], verbs[name].__doc__ or ""
    if words and words[0] not in HELP:
        hint = meant_command(words[0], program, verbs)
        raise CommandError(f"{program} has no command {words[0]!r}. {hint}")
    return tyro.extras.subcommand_cli_from_dict(
        {name: _summary(verb) for name, verb in verbs.items()},
        prog=program,
        description=description,
        args=words,
    )


def _call(
    verb: Callable[..., None], program: str, words: Sequence[str]
) -> partial[None]:
    @wraps(verb)
    def call(*args: object, **options: object) -> partial[None]:
        return partial(verb, *args, **options)

    for word, value in pairwise([*words, "--"]):
        if word == TASKS and value.startswith("--"):
            raise CommandError(f"{TASKS} needs a task; without it all are meant.")
    try:
        return tyro.cli(call, prog=program, args=words, config=CONFIG)
    except SystemExit as left:
        if left.code:
            for hint in hints(words, [option.flag for option in options_of(verb)]):
                sys.stderr.write(f"{hint}\n")
        raise


def _summary(verb: Callable[..., None]) -> Callable[[], partial[None]]:
    """Return a stand-in for a verb that has the first line of its description alone."""

    def summary() -> partial[None]:
        return partial(verb)

    summary.__doc__ = (verb.__doc__ or "").partition("\n")[0]
    return summary
