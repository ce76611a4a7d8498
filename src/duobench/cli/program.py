"""All verbs, and how their arguments are read."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence

import tyro

from duobench.cli.real import calibrate as real_calibrate
from duobench.cli.real import doctor as real_doctor
from duobench.cli.real import evaluate as real_evaluate
from duobench.cli.real import home as real_home
from duobench.cli.real import record as real_record
from duobench.cli.real import teleop as real_teleop
from duobench.cli.real import verbs as real_verbs
from duobench.cli.shared.console import console
from duobench.cli.spelling import check_spelling
from duobench.cli.verbs import data, export
from duobench.cli.verbs.bundle import bundle
from duobench.cli.verbs.compare import compare
from duobench.cli.verbs.doctor import doctor
from duobench.cli.verbs.evaluate import evaluate
from duobench.cli.verbs.leaderboard import leaderboard
from duobench.cli.verbs.list_tasks import list_tasks
from duobench.cli.verbs.print_ import print_
from duobench.cli.verbs.record import record
from duobench.cli.verbs.render import render
from duobench.cli.verbs.replay import replay
from duobench.cli.verbs.report import report
from duobench.cli.verbs.serve import serve
from duobench.cli.verbs.teleop import teleop
from duobench.cli.verbs.train import train
from duobench.cli.verbs.verify import verify
from duobench.cli.verbs.view import view
from duobench.versions import __version__

DESCRIPTION = (
    "A benchmark for two-armed manipulation on the Franka FR3 Duo. "
    "duobench --version shows the version."
)


VERBS: Mapping[str, Callable[..., None]] = {
    "eval": evaluate,
    "report": report,
    "compare": compare,
    "verify": verify,
    "bundle": bundle,
    "leaderboard": leaderboard,
    "record": record,
    "replay": replay,
    "view": view,
    "teleop": teleop,
    "list": list_tasks,
    "render": render,
    "serve": serve,
    "data": data.verbs,
    "export": export.verbs,
    "train": train,
    "print": print_,
    "real": real_verbs,
    "doctor": doctor,
}
GROUPS: Mapping[str, Mapping[str, Callable[..., None]]] = {
    "data": {
        "info": data.info,
        "check": data.check,
        "recover": data.recover,
        "merge": data.merge,
        "split": data.split,
    },
    "export": {"lerobot": export.lerobot},
    "real": {
        "doctor": real_doctor.doctor,
        "home": real_home.home,
        "calibrate": real_calibrate.calibrate,
        "record": real_record.record,
        "eval": real_evaluate.evaluate,
        "teleop": real_teleop.teleop,
    },
    "real calibrate": {
        "board": real_calibrate.board,
        "lens": real_calibrate.lens,
        "head": real_calibrate.head,
        "wrist": real_calibrate.wrist,
        "gripper": real_calibrate.gripper,
    },
}
"""Verbs that have verbs of their own."""


def run(arguments: Sequence[str] | None) -> None:
    """Read the arguments and run the verb they name."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    if words == ["--version"]:
        console().print(f"duobench {__version__}")
        return
    verbs, program, description = VERBS, "duobench", DESCRIPTION
    while words and (group := f"{program} {words[0]}".removeprefix("duobench ")) in GROUPS:
        description = verbs[words[0]].__doc__ or ""
        verbs, program, words = GROUPS[group], f"duobench {group}", words[1:]
    check_spelling(words, verbs, program, default=next(iter(verbs)) if len(verbs) == 1 else "")
    tyro.extras.subcommand_cli_from_dict(
        dict(verbs),
        prog=program,
        description=description,
        args=words,
        sort_subcommands=False,
        config=(tyro.conf.EnumChoicesFromValues,),
    )
