"""`duobench eval`: roll a policy out and report how it did."""

from __future__ import annotations

import sys
from pathlib import Path

from duobench.cli.console import console, counted
from duobench.cli.engine import load_engine
from duobench.cli.interrupt import raising


def evaluate(
    policy: str,
    out: Path,
    tasks: tuple[str, ...] = (),
    episodes: int = 20,
    first_episode: int = 0,
    workers: int = 1,
    videos: int = 1,
    retry_broken: bool = False,
) -> None:
    """Roll a policy out on tasks, and leave records, a table and a report.

    The same command in the same folder goes on where it was stopped. The exit code is 1 if an
    episode broke off with an error.

    Args:
        policy: expert, hold, random, zero, or module:attribute for a policy of your own.
        out: Folder of the run.
        tasks: Task ids (see: duobench list) or module:ATTRIBUTE; all tasks if none is named.
        episodes: Episodes of each task.
        first_episode: Index of the first episode; seeds follow from task and index alone.
        workers: Processes that play side by side; the results do not depend on it.
        videos: How many episodes of each task are filmed.
        retry_broken: Play the episodes again that broke off in an earlier call.
    """
    load_engine()
    from duobench.cli.progress import progress_display
    from duobench.evaluation import policies
    from duobench.evaluation.folder import RunFolder
    from duobench.evaluation.run import Run
    from duobench.evaluation.runner import evaluate as play
    from duobench.evaluation.suite import describe
    from duobench.evaluation.table import results_table
    from duobench.evaluation.versions import package_versions
    from duobench.randomness import SUITE_VERSION

    policies.check_name(policy)
    run = Run(
        policy=policy,
        tasks=describe(tasks),
        episodes=episodes,
        first_episode=first_episode,
        videos=videos,
        suite_version=SUITE_VERSION,
        versions=package_versions(),
    )
    folder = RunFolder(out)
    screen = console()
    try:
        with raising(), progress_display(screen) as display:
            results = play(
                run, folder, workers=workers, observers=[display], retry_broken=retry_broken
            )
    except KeyboardInterrupt:
        screen.print("What is finished is kept; the same command goes on from there.")
        raise
    screen.print(results_table(results, run.episodes))
    screen.print(f"Report: {folder.page}", soft_wrap=True)
    if results.overall.errors:
        screen.print(
            f"{counted(results.overall.errors, 'episode')} broke off, which counts as failed; "
            "the report has the tracebacks. To play what broke off again, give the same command "
            "with --retry-broken.",
            soft_wrap=True,
        )
        sys.exit(1)
