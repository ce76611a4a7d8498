"""`duobench record`: record demonstrations into a data set."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from duobench.cli.shared.console import console, counted
from duobench.cli.shared.engine import load_engine
from duobench.cli.shared.interrupt import raising
from duobench.cli.shared.options import command_line
from duobench.results.limits import TimeLimits

if TYPE_CHECKING:
    from duobench.runners.demonstrations import Attempt

_LIMITS = TimeLimits()


def record(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    out: Path,
    policy: str = "expert",
    variety: Literal["none", "human", "wide"] = "human",
    tasks: tuple[str, ...] = (),
    episodes: int = 50,
    workers: int = 1,
    split: Literal["train", "eval"] = "train",
    instructions: Literal["fixed", "varied"] = "fixed",
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
        episodes: Episodes of each task.
        workers: Processes that play side by side; the data set does not depend on it.
        split: Layouts to begin with. Those of eval are the ones that policies are evaluated on:
            whatever learns from them cannot be evaluated any more.
        instructions: What the policy is told and the data set says: the task's own instruction, or
            in each episode one that is sampled from it and ten paraphrases.
        keep_failures: Keep every episode, whether it succeeds or not.
        after_success: Seconds that a recording goes on after success, while the hands open and
            retreat; 0 ends it there.
        limits: How long the policy may take.
    """
    command = command_line("record", record, locals())
    load_engine()
    from duobench.cli.shared.advice import advising, for_recording
    from duobench.cli.shared.progress import EpisodesKept, display
    from duobench.data import DataSet
    from duobench.results.suite import find_tasks
    from duobench.runners import demonstrations

    name = f"expert:{variety}" if policy == "expert" and variety != "none" else policy
    chosen = find_tasks(tasks)
    screen = console()
    with advising(for_recording), raising(screen), display(screen, "episode") as shown:
        attempts = demonstrations.record(
            name,
            chosen,
            DataSet.open(out, how=f"duobench record --policy {name}"),
            episodes=episodes,
            split=split,
            instructions=instructions,
            keep_failures=keep_failures,
            after_success=after_success,
            limits=limits,
            workers=workers,
            observers=[EpisodesKept(shown)],
            command=command,
        )
    screen.print(_summary(attempts))


def _summary(attempts: Sequence[Attempt]) -> str:
    kept = sum(attempt.kept for attempt in attempts)
    steps = sum(attempt.steps for attempt in attempts if attempt.kept)
    failed = [attempt for attempt in attempts if not attempt.success]
    lines = [f"{counted(kept, 'episode')}, {steps} steps; {len(failed)} more did not succeed."]
    lines += [
        f"{attempt.task}, episode {attempt.episode} ended at stage {attempt.stage}"
        + (f": {attempt.error}" if attempt.error else ".")
        for attempt in failed
    ]
    return "\n".join(lines)
