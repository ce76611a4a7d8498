"""All verbs, and how their arguments are read."""

from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path

import tyro

from duobench.cli.real import arms, calibrate, check
from duobench.cli.shared.console import say
from duobench.cli.shared.process import find_scratch
from duobench.cli.shared.spelling import check_spelling
from duobench.cli.verbs import data, docs, doctor, episodes, policies, runs, tasks, teleop
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
    "leaderboard": runs.leaderboard,
    "salt": episodes.salt,
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
    "checkpoint": policies.checkpoint,
    "print": tasks.print_,
    "real": arms.real,
    "doctor": doctor.doctor,
    "docs": docs.docs,
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
    "checkpoint": {"card": policies.card},
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


def run(words: Sequence[str]) -> None:
    """Read the arguments and run the verb they name."""
    if words == ["--version"]:
        say(f"duobench {__version__}")
        return
    verbs, program, description = VERBS, "duobench", DESCRIPTION
    while words and (group := f"{program} {words[0]}".removeprefix("duobench ")) in GROUPS:
        description = verbs[words[0]].__doc__ or ""
        verbs, program, words = GROUPS[group], f"duobench {group}", words[1:]
    check_spelling(words, verbs, program, default=next(iter(verbs)) if len(verbs) == 1 else "")
    tyro.extras.subcommand_cli_from_dict(
        {name: _with_scratch(verb) for name, verb in verbs.items()},
        prog=program,
        description=description,
        args=words,
        sort_subcommands=False,
        config=(tyro.conf.EnumChoicesFromValues,),
    )


def _with_scratch(verb: Callable[..., None]) -> Callable[..., None]:
    """A verb that has a folder for temporary files, if need be at a path that it is given."""

    @wraps(verb)
    def run(*args: object, **options: object) -> None:
        given = (*args, *options.values())
        find_scratch(path for path in given if isinstance(path, Path))
        verb(*args, **options)

    return run
