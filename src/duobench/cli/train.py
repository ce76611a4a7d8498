"""`duobench train`: a policy, trained with LeRobot."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import say
from duobench.core.errors import DataError, NoObjectStatesError, UnknownNumbersError

if TYPE_CHECKING:
    from duobench.policy.training.training import Training


EXPORT = "duobench export lerobot DATA --out OUT --after-success"


def run(  # noqa: PLR0913 - each is an argument of the command line
    policy: tyro.conf.Positional[
        Literal["act", "diffusion", "groot", "pi05", "smolvla", "xvla"]
    ],
    more: tyro.conf.Positional[tuple[str, ...]] = (),
    *,
    data: Path,
    out: Path,
    tasks: tuple[str, ...] = (),
    steps: int | None = None,
    small: bool = False,
    domain_ids: bool = False,
    assume: Literal["joint", "cartesian", "cartesian_relative"] | None = None,
    only_print: Annotated[bool, tyro.conf.arg(name="print")] = False,
) -> None:
    """Train a policy with LeRobot: print the command that does it, with its reasons, and run it.

    The same command goes on where it was stopped, from the last checkpoint. Several tasks of a kind
    that learns one are trained one after the other, each in a folder of its own.

    Args:
        policy: Kind of policy: act and diffusion learn one task, groot, pi05, smolvla and xvla all
            of them; diffusion learns from object states, and act from them or from images.
        more: More options of lerobot-train, after --, such as -- --batch_size=8.
        data: Folder of a data set of LeRobot with this benchmark's names and sizes, such as
            duobench export lerobot makes; or of several, as its --per-task makes them, or as the
            paper's authors publish theirs, TASK/sim.
        out: Folder of the training, or of one folder for each task.
        tasks: Ids of the tasks to learn, or all, those of the data set; act learns each of them by
            itself.
        steps: Steps of the optimizer.
        small: Take a small model for a processor without graphics card (act only), to see that
            everything works together.
        domain_ids: Tell the policy which episodes are simulated and which are real (xvla only);
            the paper does not, and an evaluation says simulation everywhere.
        assume: What the actions of others' data are, where their names do not say it; a state of 16
            numbers is then joints and openings.
        only_print: Print the command and do not run it.
    """
    from duobench.data.dataset import DESCRIPTION
    from duobench.policy.training import training

    try:
        trainings = training.plan_all(
            policy,
            data,
            out,
            tasks=tasks,
            steps=steps,
            small=small,
            domain_ids=domain_ids,
            assume=assume,
        )
    except UnknownNumbersError as error:
        raise AdvisedError(f"{error} Such as: --assume joint") from error
    except DataError as error:
        recorded = (data / DESCRIPTION).exists()
        if not recorded and not isinstance(error, NoObjectStatesError):
            raise
        export = (
            f"duobench export lerobot {data} --out {data}-lerobot --after-success"
            if recorded
            else EXPORT
        )
        if policy not in training.RECIPES:
            export += " --per-task --cameras none --object-state"
        raise AdvisedError(f"{error} The command: {export}") from error
    missing = [each for each in trainings if not each.is_finished(more)]
    _show_commands(trainings, missing, more)
    if only_print:
        return
    for number, each in enumerate(missing, start=1):
        if len(missing) > 1:
            say(f"Training {number} of {len(missing)}: {' '.join(each.tasks)}")
        words = each.command(more)[1:]
        code = subprocess.run([training.program(), *words], check=False).returncode
        each.name_features()
        if code:
            sys.exit(code)
    for each in trainings:
        say(f"Evaluate it: {_evaluation(each)}")


def _evaluation(training: Training) -> str:
    names = "".join(f" {task}" for task in training.tasks)
    return (
        f"duobench eval --policy lerobot:{training.checkpoint}"
        f"{' --tasks' + names if names else ''} --episodes 100 "
        f"--out {training.folder / 'evaluation'}"
    )


def _show_commands(
    trainings: Sequence[Training], missing: Sequence[Training], more: Sequence[str]
) -> None:
    """Print the commands; their reasons apart, so that the commands can be piped into a shell."""
    for each in trainings:
        if each in missing:
            say(" \\\n  ".join(map(shlex.quote, each.command(more))))
        else:
            say(f"# Finished: {each.checkpoint}")
    for each in missing[:1]:  # the others have the same reasons
        width = max(len(setting.argument) for setting in each.settings)
        for setting in each.settings:
            sys.stderr.write(f"{setting.argument:{min(width, 48)}}  {setting.why}\n")
    for note in dict.fromkeys(note for each in missing for note in each.notes):
        sys.stderr.write(f"{note}\n")
