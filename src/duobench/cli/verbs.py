"""All verbs, and how their arguments are read."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import tyro

from duobench import __version__
from duobench.cli.console import console
from duobench.cli.doctor import doctor
from duobench.cli.evaluate import evaluate
from duobench.cli.list_tasks import list_tasks
from duobench.cli.record import record
from duobench.cli.render import render
from duobench.cli.replay import replay
from duobench.cli.report import report
from duobench.cli.serve import serve

DESCRIPTION = (
    "A benchmark for two-armed manipulation on the Franka FR3 Duo. "
    "duobench --version shows the version."
)


def run(arguments: Sequence[str] | None) -> None:
    """Read the arguments and run the verb they name."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    if words == ["--version"]:
        console().print(f"duobench {__version__}")
        return
    tyro.extras.subcommand_cli_from_dict(
        {
            "eval": evaluate,
            "report": report,
            "serve": serve,
            "record": record,
            "replay": replay,
            "list": list_tasks,
            "render": render,
            "doctor": doctor,
        },
        prog="duobench",
        description=DESCRIPTION,
        args=words,
        sort_subcommands=False,
    )
