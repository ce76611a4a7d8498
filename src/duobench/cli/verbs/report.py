"""`duobench report`: write the report of a run anew, and make videos of its episodes."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.shared.advice import AdvisedError, conditions_of, find_runs, relative
from duobench.cli.shared.console import console, counted
from duobench.cli.shared.engine import load_engine

if TYPE_CHECKING:
    from rich.console import Console

    from duobench.replay.missing import Made
    from duobench.results.folder import RunFolder
    from duobench.results.reader import RunReader


def report(
    source: tyro.conf.Positional[tuple[Path, ...]],
    out: Path | None = None,
    videos: tuple[str, ...] = (),
    replays: tuple[str, ...] = (),
    import_tasks: bool = False,
) -> None:
    """Compute table, figures and page from the records of a run.

    The exit code is 1 if a video or a replay that was asked for cannot be made.

    Args:
        source: What was given to --out of duobench eval, whose run need not be finished, or a file
            that duobench bundle has written, or the folders of all shards of a run.
        out: Folder of the report of a bundle, or of shards that do not lie in one folder; that of a
            run lies in the run's own folder.
        videos: Make videos of these finished episodes first, from what was sent in them: failures,
            all, or TASK:EPISODE such as bin_sort:3, one or several. One that is there stays.
        replays: Show these finished episodes in 3D on the page: as for --videos, but failures and
            all choose 20 at most, of all tasks and last stages.
        import_tasks: For videos and replays, import tasks that are not of the benchmark. This runs
            the code of the modules that the run names.
    """
    find_runs(source)
    if len(source) == 1 and conditions_of(source[0]):
        if out is not None or videos or replays:
            raise AdvisedError(
                f"{source[0]} holds conditions: only its own page is made. Ask for videos or a "
                f"bundle of one of them, such as {source[0] / 'none'}."
            )
        _report_conditions(source[0])
        return
    from duobench.cli.shared.table import results_table
    from duobench.results.folder import RunFolder
    from duobench.results.report import read_results, write_report
    from duobench.results.source import open_sources

    reader = open_sources(source)
    run_folder = _place(reader, out)
    run, results = read_results(reader)
    screen = console()
    # First, so that the table of a folder can be had by who may only read it.
    screen.print(results_table(run, results))
    elsewhere = None if isinstance(reader, RunFolder) else reader
    write_report(run_folder, elsewhere)
    impossible = 0
    if videos or replays:
        load_engine()
        from duobench.replay.tracks import choose_few, make_replays
        from duobench.replay.videos import choose, make_videos

        for what, words, pick, make in (
            ("video", videos, choose, make_videos),
            ("replay", replays, choose_few, make_replays),
        ):
            if words:
                records = pick(run, [each for one in results.tasks for each in one.records], words)
                todo = partial(make, run_folder, run, records, import_tasks=import_tasks)
                impossible += _make(what, todo, screen, import_tasks)
        write_report(run_folder, elsewhere)
    screen.print(f"Report: {relative(run_folder.page)}")
    if impossible:
        sys.exit(1)


def _report_conditions(path: Path) -> None:
    """Write the report of a suite that was played under shifts, and those of its conditions."""
    from duobench.results.report import write_report
    from duobench.results.robustness.conditions import open_conditions, read_robustness
    from duobench.results.robustness.report import write_robustness

    for reader in open_conditions(path).values():
        folder = _place(reader, None)
        write_report(folder, None if folder.description.exists() else reader)
    page = write_robustness([read_robustness(path)], path)
    console().print(f"Report: {relative(page)}")


def _place(reader: RunReader, out: Path | None) -> RunFolder:
    """Where the report of a run is written."""
    from duobench.results.folder import RunFolder
    from duobench.results.suites.merged import MergedFolder, MergedRun

    if isinstance(reader, MergedRun):
        if out is None and len({shard.path.parent for shard in reader.shards}) > 1:
            raise AdvisedError("The shards lie in several folders: say with --out where to report.")
        return MergedFolder(out or reader.path, reader)
    if isinstance(reader, RunFolder) != (out is None):
        raise AdvisedError(
            f"{reader.path} is a bundle: say with --out where its report shall be."
            if out is None
            else "--out is for the report of a bundle; that of a run lies in the run's own folder."
        )
    return RunFolder(out or reader.path)


def _make(what: str, make: Callable[..., Made], screen: Console, import_tasks: bool) -> int:
    """Make videos or replays, and return how many cannot be made."""
    from duobench.cli.shared.progress import display
    from duobench.tasks import catalog

    with display(screen, what) as shown:
        found = make(progress=shown.tell)
    for record, reason in found.impossible:
        screen.print(f"No {what} of {record.task}, episode {record.episode}: {reason}")
    if {record.task for record, _ in found.impossible} - set(catalog.names()) and not import_tasks:
        screen.print("With --import-tasks its tasks are imported; that runs the code of others.")
    there = f", {len(found.there)} there before" if found.there else ""
    screen.print(f"{counted(len(found.made), what)} made{there}")
    return len(found.impossible)
