"""`duobench record`: demonstrations of policies and scripted experts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from duobench.cli.shared.advice import FOR_RECORDING, advising
from duobench.cli.shared.console import counted, say
from duobench.cli.shared.options import command_line
from duobench.cli.shared.process import load_engine, raising
from duobench.cli.shared.progress import EpisodesKept, display
from duobench.core.files import taken_back
from duobench.results.run import TimeLimits
from duobench.results.suite import find_tasks
from duobench.world.robot.gripper import DEFAULT_GRIPPER

if TYPE_CHECKING:
    from duobench.evaluation.runners.evaluations import Attempt


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodesRecorded:
    """Which episodes are recorded."""

    episodes: int = 50
    """Episodes of each task."""
    first: int = 0
    """Index of the first one; seeds follow from task and index alone, so that folders with other
    indices hold other episodes. A folder goes on from the one it was begun with."""
    split: Literal["train", "eval"] = "train"
    """Layouts to begin with. Those of eval are the ones that policies are evaluated on: a policy
    that learns from them cannot be evaluated any more."""


_LIMITS = TimeLimits()
_EPISODES = EpisodesRecorded()


def run(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    out: Path,
    policy: str = "expert",
    variety: Literal["none", "human", "wide"] = "human",
    tasks: tuple[str, ...] = (),
    which: tyro.conf.OmitArgPrefixes[EpisodesRecorded] = _EPISODES,
    workers: int = 1,
    instructions: Literal["fixed", "varied"] = "fixed",
    gripper: str = DEFAULT_GRIPPER,
    keep_failures: bool = False,
    after_success: float = 1.0,
    limits: tyro.conf.OmitArgPrefixes[TimeLimits] = _LIMITS,
) -> None:
    """Record demonstrations: states and actions; images are rendered from them later.

    Every task gets that many successful episodes; those that fail are counted and left out. The
    same command in the same folder goes on where it was stopped, also with more episodes.

    Args:
        out: Folder of the data set.
        policy: expert, hold, random, zero, or module:attribute for a policy of your own.
        variety: How much the scripted experts vary their speed, ways and grasps, and are disturbed;
            only they know how to.
        tasks: Task ids (see: duobench list) or module:ATTRIBUTE; all tasks if none is named.
        which: Which episodes are recorded.
        workers: Processes that play side by side.
        instructions: What the policy is told and the data set says: the task's own instruction, or
            in each episode one that is sampled from it and ten paraphrases.
        gripper: Gripper on both arms, such as franka_hand, or module:ATTRIBUTE.
        keep_failures: Keep every episode, whether it succeeds or not.
        after_success: Seconds that a recording goes on after success, while the hands open and
            retreat; 0 ends it there.
        limits: How long the policy may take.
    """
    command = command_line("record", run, locals())
    load_engine()
    from duobench.data import DataSet
    from duobench.data.attempts import RUN
    from duobench.data.dataset import DESCRIPTION
    from duobench.evaluation.runners import record as record_demonstrations

    name = f"expert:{variety}" if policy == "expert" and variety != "none" else policy
    beginnings = DESCRIPTION, RUN
    with (
        raising(out),
        taken_back(out, *beginnings),
        advising(FOR_RECORDING),
        display("episode") as shown,
    ):
        attempts = record_demonstrations(
            name,
            find_tasks(tasks),
            DataSet.open(out, how=f"duobench record --policy {name}"),
            episodes=which.episodes,
            first=which.first,
            split=which.split,
            instructions=instructions,
            keep_failures=keep_failures,
            after_success=after_success,
            limits=limits,
            workers=workers,
            gripper=gripper,
            observers=[EpisodesKept(shown)],
            command=command,
        )
    say(_kept_and_failed(attempts))


def _kept_and_failed(attempts: Sequence[Attempt]) -> str:
    kept = [attempt for attempt in attempts if attempt.kept]
    steps = sum(attempt.steps for attempt in kept if attempt.success)
    failed = [attempt for attempt in attempts if not attempt.success]
    more = sum(not attempt.kept for attempt in failed)
    lines = [
        f"{counted(len(kept), 'episode')}, {steps} steps until success, after which frames are "
        f"still recorded (--after-success); {more} more did not succeed."
    ]
    unsolved = len(failed) - more
    if unsolved:
        lines.append(f"{unsolved} of the episodes did not succeed.")
    lines += [
        f"{attempt.task}, episode {attempt.episode} ended at stage {attempt.stage}"
        + (f": {attempt.error}" if attempt.error else ".")
        for attempt in failed
    ]
    return "\n".join(lines)
