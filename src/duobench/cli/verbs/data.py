"""`duobench data`: look at data sets, check them, put them together and take them apart."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from duobench.cli.shared.advice import AdvisedError, advising, find_folder
from duobench.cli.shared.console import console, counted
from duobench.cli.shared.engine import load_engine
from duobench.errors import DataError, DuoBenchError, NamesTakenError, OutputError

if TYPE_CHECKING:
    from rich.table import Table

    from duobench.data import DataSet
    from duobench.data.summary import Summary, TaskSummary


def opened(folder: Path) -> DataSet:
    """The data set in a folder.

    Raises:
        DuoBenchError: There is none, or MuJoCo cannot be loaded.
    """
    find_folder(folder, "dataset.json")
    load_engine()
    from duobench.data import DataSet

    return DataSet.open(folder, create=False)


def verbs() -> None:
    """Look at data sets, check them, put them together and take them apart."""


def info(data: tyro.conf.Positional[Path], images: bool = True) -> None:
    """Show what a data set adds up to, and write a page about it into its folder.

    Args:
        data: Folder of the data set.
        images: Show images of each task on the page, which takes a moment.
    """
    source = opened(data)
    from rich import box
    from rich.table import Table

    from duobench.data import summarize, write_page

    summary = summarize(source)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("Task", no_wrap=True)
    for heading in ("Episodes", "Successes", "Frames", "Median", "99 %", "Horizon"):
        table.add_column(heading, justify="right", no_wrap=True)
    for task in summary.tasks:
        middle, long = f"{task.median_length:g}", f"{task.long_length:.0f}"
        numbers = (task.episodes, task.successes, task.frames, middle, long, task.horizon)
        table.add_row(task.task, *map(str, numbers))
    table.add_section()
    whole = (summary.episodes, summary.successes, summary.frames)
    table.add_row("All tasks", *map(str, whole), style="bold")
    screen = console()
    screen.print(table)
    screen.print(_smoothness(summary))
    screen.print(f"Episodes: {summary.domains}")
    if summary.left_out:
        screen.print(f"Frames missing in videos, left out by a late encoder: {summary.left_out}")
    for line in _actors(summary):
        screen.print(line)
    screen.print(f"Page: {write_page(source, summary, images=images)}")


def _actors(summary: Summary) -> Iterator[str]:
    """Who acted, with the tasks where it was not the same in all."""
    actors: dict[str, list[TaskSummary]] = {}
    for task in summary.tasks:
        for actor in task.actors:
            actors.setdefault(actor, []).append(task)
    for actor, tasks in actors.items():
        where = "" if len(tasks) == len(summary.tasks) else f" ({', '.join(t.task for t in tasks)})"
        yield f"Recorded by {actor}{where}"
    for task in summary.tasks:
        if task.led is not None:
            yield f"{task.task}: a hand led an arm in {task.led:.0%} of the steps"


def _smoothness(summary: Summary) -> Table:
    """What joint targets do that is hard to learn, task by task."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("Task", no_wrap=True)
    for heading in ("Steps at a joint limit", "Reversals an episode", "Steps with a jump"):
        table.add_column(heading, justify="right")
    for task in summary.tasks:
        found = task.smoothness
        shares = f"{found.at_limit:.1%}", f"{found.reversals:.1f}", f"{found.jumps:.1%}"
        table.add_row(task.task, *shares)
    return table


def check(data: tyro.conf.Positional[Path], workers: int = 1) -> None:
    """Check every file of a data set; exit code 1 if something is wrong.

    Args:
        data: Folder of the data set.
        workers: Processes that check side by side.
    """
    source = opened(data)
    from duobench.cli.shared.progress import display
    from duobench.data import find_problems

    screen = console()
    with display(screen, "episode") as shown:
        problems = find_problems(source, workers=workers, progress=shown.tell)
    for problem in problems:
        screen.print(f"{problem.path}: {problem.what}")
    episodes = counted(len(source.episodes()), "episode")
    screen.print(f"{episodes}, {counted(len(problems), 'problem')}")
    if problems:
        sys.exit(1)


def recover(data: tyro.conf.Positional[Path]) -> None:
    """Turn what killed recordings have left into episodes that say that they were cut.

    Episodes that another process is recording at this moment are left alone.

    Args:
        data: Folder of the data set.
    """
    source = opened(data)
    from duobench.files import locked

    screen, found, lost = console(), 0, 0
    with locked(source.path):
        for partial in source.partials():
            try:
                screen.print(str(source.recover(partial)))
                found += 1
            except (DataError, OutputError) as error:
                lost += 1
                screen.print(str(error))
    if found:
        screen.print(f"{counted(found, 'episode')} recovered.")
    elif not lost:
        screen.print("There is nothing to recover.")
    if lost:
        sys.exit(1)


def merge(data: tyro.conf.Positional[tuple[Path, ...]], out: Path, rename: bool = False) -> None:
    """Copy the episodes of several data sets into one.

    Args:
        data: Folders of the data sets.
        out: Folder of the merged data set; it is added to if it exists.
        rename: Give an episode whose name is taken the next free number.
    """
    sources = [opened(each) for each in data]
    from duobench.data.arrange import merge as merge_into

    with advising(_for_merging):
        count = merge_into(sources, out, rename=rename)
    console().print(f"{counted(count, 'episode')} in {out}")


def _for_merging(error: DuoBenchError) -> str | None:
    if isinstance(error, NamesTakenError):
        return "With --rename they get the next free numbers."
    return None


def split(
    data: tyro.conf.Positional[Path],
    out: tuple[Path, Path],
    fraction: float | None = None,
    tasks: tuple[str, ...] = (),
    seed: int = 0,
) -> None:
    """Copy the episodes of a data set into two new ones, without an episode that is in both.

    Args:
        data: Folder of the data set.
        out: Folders of the two.
        fraction: Share of each task's episodes that go into the first, such as 0.8.
        tasks: Tasks that go into the first, instead of a fraction.
        seed: Seed of the choice.
    """
    source = opened(data)
    if (fraction is None) == (not tasks):
        raise AdvisedError(
            "Say what goes into the first folder: a share of each task's episodes, such as "
            "--fraction 0.8, or all of some tasks, such as --tasks bin_sort."
        )
    from duobench.data.arrange import split as split_into

    counts = split_into(source, *out, fraction=fraction, tasks=tasks, seed=seed)
    for folder, count in zip(out, counts, strict=True):
        console().print(f"{counted(count, 'episode')} in {folder}")
