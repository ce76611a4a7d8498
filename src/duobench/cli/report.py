"""`duobench report`: table, figures and page of a run."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.shared.advice import (
    AdvisedError,
    find_run,
    offer_to_import,
    relative,
)
from duobench.cli.shared.console import counted, results_table, say
from duobench.cli.shared.folders import tell_missing
from duobench.cli.shared.process import load_engine
from duobench.cli.shared.progress import display
from duobench.results.bundle import open_source
from duobench.results.folder import RunFolder
from duobench.results.scores import RunPart
from duobench.tasks.shifts.shift import NO_SHIFT

if TYPE_CHECKING:
    from duobench.evaluation.replay.render import RenderResult


def run(
    source: tyro.conf.Positional[Path],
    out: Path | None = None,
    videos: tuple[str, ...] = (),
    video_look: str | None = None,
    replays: tuple[str, ...] = (),
    import_tasks: bool = False,
) -> None:
    """Compute table, figures and page from the records of a run.

    The exit code is 1 if a video or a replay that was asked for cannot be made.

    Args:
        source: What was given to --out of duobench eval, whose run need not be finished, or a file
            that duobench bundle has written.
        out: Folder of the report of a bundle; that of a run lies in the run's own folder.
        videos: Make videos of these finished episodes first, from what was sent in them: failures,
            all, or TASK:EPISODE such as bin_sort:3, one or several. One that is there stays.
        video_look: Look of the table in them, such as studio; without one, that of the run.
        replays: Show these finished episodes in 3D on the page: as for --videos, but failures and
            all choose 20 at most, of all tasks and last stages.
        import_tasks: For videos and replays, import tasks that are not of the benchmark. This runs
            the code of the modules that the run names.
    """
    find_run(source)
    from duobench.results.report import missing_shards, read_parts, write_report

    reader = open_source(source)
    if isinstance(reader, RunFolder) != (out is None):
        raise AdvisedError(
            f"{source} is a bundle: say with --out where its report shall be."
            if out is None
            else "--out is for the report of a bundle; that of a run lies in the run's own folder."
        )
    folder = RunFolder(out or source)
    parts = read_parts(reader)
    tell_missing(reader)
    if len(parts) == 1:
        # First, so that the table of a folder can be had by who may only read it.
        say(results_table(parts[0]))
    elsewhere = None if isinstance(reader, RunFolder) else reader
    write_report(folder, elsewhere)
    impossible = 0
    if videos or replays:
        impossible = _make_chosen(
            folder, parts, videos, replays, import_tasks, video_look
        )
        write_report(folder, elsewhere)
    missing = missing_shards(folder, parts[0].run)
    if missing:
        say(missing)
    say(f"Report: {relative(folder.page)}")
    if impossible:
        sys.exit(1)


def _make_chosen(
    folder: RunFolder,
    parts: Sequence[RunPart],
    videos: Sequence[str],
    replays: Sequence[str],
    import_tasks: bool,
    video_look: str | None,
) -> int:
    """Make videos and replays of the episodes that words choose; how many cannot be made."""
    load_engine()
    from duobench.evaluation.replay.render import (
        REPLAY,
        VIDEO,
        choose,
        choose_few,
        make_missing,
    )

    run, records = parts[0].run, [record for part in parts for record in part.records]
    impossible = 0
    for what, words, pick in ((VIDEO, videos, choose), (REPLAY, replays, choose_few)):
        if words:
            chosen = pick(run, records, words)
            if not chosen:
                say(
                    f"No {what} is made: {' '.join(words)} chooses none of the episodes."
                )
                continue
            todo = partial(
                make_missing,
                folder,
                run,
                chosen,
                what,
                import_tasks=import_tasks,
                video_look=video_look,
            )
            impossible += _make(what, todo, import_tasks)
    return impossible


def _make(
    what: str,
    make: Callable[..., RenderResult],
    import_tasks: bool,
) -> int:
    with display(what) as shown:
        found = make(progress=shown.tell)
    for record, reason in found.impossible:
        shift = record.condition.shift
        under = "" if shift == NO_SHIFT else f", {shift}"
        say(f"No {what} of {record.task}, episode {record.episode}{under}: {reason}")
    offer_to_import(
        {record.task for record, _ in found.impossible}, import_tasks=import_tasks
    )
    there = f", {len(found.there)} there before" if found.there else ""
    say(f"{counted(len(found.made), what)} made{there}")
    return len(found.impossible)
