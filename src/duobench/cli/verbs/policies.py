"""`duobench train` and `duobench serve`: policies."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from duobench.cli.shared.advice import AdvisedError, find_run
from duobench.cli.shared.console import say
from duobench.cli.shared.process import stopping
from duobench.core.errors import DataError, NoObjectStatesError, ServingError
from duobench.core.lerobot_keys import ID
from duobench.policy.batch import Batching
from duobench.policy.registry import reads_simulation
from duobench.policy.serving.access import check_access, read_key

if TYPE_CHECKING:
    from duobench.policy.training.training import Training

EXPORT = "duobench export lerobot DATA --out OUT"


def train(  # noqa: PLR0913 - each is an argument of the command line
    policy: tyro.conf.Positional[Literal["act", "diffusion", "groot", "pi05", "smolvla", "xvla"]],
    more: tyro.conf.Positional[tuple[str, ...]] = (),
    *,
    data: Path,
    out: Path,
    tasks: tuple[str, ...] = (),
    steps: int | None = None,
    small: bool = False,
    domain_ids: bool = False,
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
            duobench export lerobot makes; or of several, as its --per-task makes them.
        out: Folder of the training, or of one folder for each task.
        tasks: Ids of the tasks to learn, or all, those of the data set; act learns each of them by
            itself.
        steps: Steps of the optimizer.
        small: Take a small model for a processor without graphics card (act only), to see that
            everything works together.
        domain_ids: Tell the policy which episodes are simulated and which are real (xvla only);
            the paper does not, and an evaluation says simulation everywhere.
        only_print: Print the command and do not run it.
    """
    from duobench.data.dataset import DESCRIPTION
    from duobench.policy.training import training

    try:
        trainings = training.plan_all(
            policy, data, out, tasks=tasks, steps=steps, small=small, domain_ids=domain_ids
        )
    except DataError as error:
        recorded = (data / DESCRIPTION).exists()
        if not recorded and not isinstance(error, NoObjectStatesError):
            raise
        export = f"duobench export lerobot {data} --out {data}-lerobot" if recorded else EXPORT
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


def checkpoint() -> None:
    """Prepare a trained policy for others."""


def card(
    checkpoint: tyro.conf.Positional[Path], run: Path, name: str = ID, licence: str = "apache-2.0"
) -> None:
    """Write the card of a checkpoint, README.md as the Hub shows it, with the bundle of a run.

    Args:
        checkpoint: Folder of a checkpoint of LeRobot, or of the file that a policy reads.
        run: What was given to --out of duobench eval, or a file that duobench bundle has written.
        name: Its id on the Hub, as commands on the card name it.
        licence: The Hub's word for what others may do with it.
    """
    find_run(run)
    if not checkpoint.is_dir():
        raise AdvisedError(f"There is no folder {checkpoint}; a checkpoint of LeRobot is one.")
    from duobench.results.card import write_checkpoint_card

    say(f"Card: {write_checkpoint_card(checkpoint, run, name, licence)}")
    say(f"Upload: {shlex.join(['hf', 'upload', name, str(checkpoint)])}")


def serve(
    policy: str,
    host: str = "127.0.0.1",
    port: int = 8000,
    max_batch: int = 8,
    batch: Literal["fixed", "dynamic"] = "fixed",
    key_file: Path | None = None,
) -> None:
    """Serve a policy over openpi's WebSocket protocol, until Ctrl-C.

    Evaluate it with: duobench eval --policy openpi --server ws://HOST:PORT

    Args:
        policy: module:attribute for a policy of your own, lerobot:PATH_OR_ID for a checkpoint of
            LeRobot, or hold, random, zero.
        host: Address to listen at. Any but that of this machine needs a key.
        port: Port to listen at; 0 takes a free one.
        max_batch: Observations that are answered together, at most. A policy that plays one episode
            at a time is made as often as that.
        batch: fixed fills every batch up to --max-batch; dynamic takes what waits, which is faster.
        key_file: File with the key that clients must have, in place of DUOBENCH_API_KEY.
    """
    if reads_simulation(policy):
        raise ServingError(
            f"{policy} reads the state of the simulator, which no client sends, so it cannot be "
            "served. Serve hold, random, zero, lerobot:PATH_OR_ID or module:attribute."
        )
    from duobench.policy.serving.host import PolicyHost, make_served

    key = read_key(key_file)
    check_access(host, key)  # before the weights are loaded
    served, metadata, batching = make_served(policy, Batching(mode=batch, size=max_batch))
    place = PolicyHost(served, metadata, batching, host=host, port=port, key=key)
    shown = f"[{host}]" if ":" in host else host
    with stopping(place.stop):
        say(
            f"Serving {metadata.name} at ws://{shown}:{place.port}, "
            f"{'with' if key else 'without'} a key, in {batching.mode} batches of at most "
            f"{batching.size}. Ctrl-C ends it.",
        )
        place.run()
