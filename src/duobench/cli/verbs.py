"""All verbs, and how their arguments are read."""

from __future__ import annotations

from collections.abc import Sequence

import tyro

from duobench.cli.doctor import doctor
from duobench.cli.evaluate import evaluate
from duobench.cli.list_tasks import list_tasks
from duobench.cli.render import render
from duobench.cli.report import report

DESCRIPTION = "A benchmark for two-armed manipulation on the Franka FR3 Duo."


def run(arguments: Sequence[str] | None) -> None:
    """Read the arguments and run the verb they name."""
    tyro.extras.subcommand_cli_from_dict(
        {
            "eval": evaluate,
            "report": report,
            "list": list_tasks,
            "render": render,
            "doctor": doctor,
        },
        prog="duobench",
        description=DESCRIPTION,
        args=arguments,
        sort_subcommands=False,
    )
