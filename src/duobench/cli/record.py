"""`duobench record`: record demonstrations into a data set."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from duobench.cli.display.console import command_line, console, counted
from duobench.cli.doctor import load_engine
from duobench.cli.interrupt import raising

if TYPE_CHECKING:
    from duobench.runners.demonstrations import Attempt


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
    act_timeout: float = 120.0,
    episode_timeout: float = 1800.0,
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
        act_timeout: Seconds that the policy may take for one reset or one chunk of actions.
        episode_timeout: Seconds that an episode may take.
    """
    command = command_line("record", record, locals())
    load_engine()
    from duobench.cli.advice import advising, for_recording
    from duobench.cli.display.progress import EpisodesKept, display
    from duobench.data import DataSet
    from duobench.results.limits import TimeLimits
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
            limits=TimeLimits(act_s=act_timeout, episode_s=episode_timeout),
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
