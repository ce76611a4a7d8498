"""`duobench train`: train a policy with LeRobot, by one command of its own."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro

from duobench.cli.display.console import console


def train(
    policy: tyro.conf.Positional[Literal["act", "pi05", "xvla"]],
    more: tyro.conf.Positional[tuple[str, ...]] = (),
    *,
    data: Path,
    out: Path,
    tasks: tuple[str, ...] = (),
    steps: int | None = None,
    small: bool = False,
    only_print: Annotated[bool, tyro.conf.arg(name="print")] = False,
) -> None:
    """Train a policy with LeRobot: print the command that does it, with its reasons, and run it.

    The same command goes on where it was stopped, from the last checkpoint.

    Args:
        policy: Kind of policy: act learns one task; pi05 and xvla learn all of them.
        more: More options of lerobot-train, after --, such as -- --batch_size=8.
        data: Folder of a data set of LeRobot with this benchmark's names and sizes, such as
            duobench export lerobot makes.
        out: Folder of the training.
        tasks: Ids of the tasks to learn; all of the data set if none is named.
        steps: Steps of the optimizer.
        small: Take a small model for a processor without graphics card (act only), to see that
            everything works together.
        only_print: Print the command and do not run it.
    """
    from duobench.cli.advice import AdvisedError
    from duobench.data.dataset import DESCRIPTION
    from duobench.errors import DataError
    from duobench.training import training

    try:
        planned = training.plan(policy, data, out, tasks=tasks, steps=steps, small=small)
    except DataError as error:
        if not (data / DESCRIPTION).exists():
            raise
        export = f"duobench export lerobot {data} --out {data}-lerobot"
        raise AdvisedError(f"{error} The command: {export}") from error
    command = planned.command(more)
    screen = console()
    screen.print(" \\\n  ".join(map(shlex.quote, command)))
    width = max(len(setting.argument) for setting in planned.settings)
    for setting in planned.settings:  # apart, so that what is printed can be piped into a shell
        sys.stderr.write(f"{setting.argument:{min(width, 48)}}  {setting.why}\n")
    if only_print:
        return
    code = subprocess.run([training.program(), *command[1:]], check=False).returncode
    planned.name_features()
    if code:
        sys.exit(code)
    names = "".join(f" {task}" for task in planned.tasks)
    screen.print(
        f"Evaluate it: duobench eval --policy lerobot:{planned.checkpoint}"
        f"{' --tasks' + names if names else ''} --episodes 100 --out {out / 'evaluation'}",
    )
