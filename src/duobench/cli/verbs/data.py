"""`duobench data` and `duobench export`: data sets, and the formats that policies learn from."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import tyro
from rich.table import Table

from duobench.cli.shared.advice import (
    FOREIGN,
    Advice,
    AdvisedError,
    advising,
    find_folder,
    offer_to_import,
)
from duobench.cli.shared.console import counted, numeric, say, table, whole
from duobench.cli.shared.process import load_engine, raising
from duobench.cli.shared.progress import display
from duobench.core.errors import (
    DataError,
    FileError,
    NamesTakenError,
    OutputError,
    SeveralTasksError,
)
from duobench.core.files import locked, taken_back
from duobench.core.lerobot_keys import ID
from duobench.data.lerobot.options import EpisodeChoice, ExportForm, ExportOptions
from duobench.tasks import catalog

if TYPE_CHECKING:
    from duobench.data import DataSet
    from duobench.data.summary import Summary, TaskSummary


def opened(folder: Path, tasks: tuple[str, ...] = (), *, import_tasks: bool = False) -> DataSet:
    """The data set in a folder; an error if there is none, or MuJoCo cannot be loaded.

    Of the tasks that were named, those of one's own are imported.
    """
    find_folder(folder, "dataset.json")
    load_engine()
    from duobench.data import DataSet

    own = catalog.import_paths(tasks)
    return DataSet.open(folder, create=False, import_tasks=import_tasks, own_tasks=own)


AS_NOTED = "beside what was noted of attempts"


def data() -> None:
    """Look at data sets, check them, put them together and take them apart."""


def info(data: tyro.conf.Positional[Path], images: bool = True, import_tasks: bool = False) -> None:
    """Show what a data set adds up to, and write a page about it into its folder.

    Args:
        data: Folder of the data set.
        images: Show images of each task on the page, which takes a moment.
        import_tasks: Import tasks that are not of the benchmark, which runs the code of the modules
            that the data set names.
    """
    source = opened(data, import_tasks=import_tasks)
    from duobench.data import summarize, write_page

    with advising(FOREIGN):
        summary = summarize(source)
    columns = numeric("Episodes", "Successes", "Frames", "Median", "99 %", "Horizon")
    rows = table(whole("Task"), *columns)
    for task in summary.tasks:
        middle, long = f"{task.median_length:g}", f"{task.long_length:.0f}"
        numbers = (task.episodes, task.successes, task.frames, middle, long, task.horizon)
        rows.add_row(task.task, *map(str, numbers))
    rows.add_section()
    overall = (summary.episodes, summary.successes, summary.frames)
    rows.add_row("All tasks", *map(str, overall), style="bold")
    rows.caption = "Frames: all control steps, 30 a second. Median, 99 %: steps until success."
    say(rows)
    say(_smoothness(summary))
    say(f"Episodes: {summary.domains}")
    if summary.left_out:
        say(f"Frames missing in videos, left out by a late encoder: {summary.left_out}")
    for line in _actors(summary):
        say(line)
    for task, words in summary.differences.items():
        say(f"{task}, {AS_NOTED}: {words}")
    say(f"Page: {write_page(source, summary, images=images)}")


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
        if task.attempted:
            yield f"{task.task}: {task.attempted}"
        if task.led is not None:
            yield f"{task.task}: a hand led an arm in {task.led:.0%} of the steps"


def _smoothness(summary: Summary) -> Table:
    """What joint targets do that is hard to learn, task by task."""
    columns = numeric("Steps at a\njoint limit", "Reversals\nan episode", "Steps with\na jump")
    rows = table(whole("Task"), *columns)
    for task in summary.tasks:
        found = task.smoothness
        shares = f"{found.at_limit:.1%}", f"{found.reversals:.1f}", f"{found.jumps:.1%}"
        rows.add_row(task.task, *shares)
    return rows


def check(data: tyro.conf.Positional[Path], workers: int = 1, import_tasks: bool = False) -> None:
    """Check every file of a data set; exit code 1 if something is wrong.

    Args:
        data: Folder of the data set.
        workers: Processes that check side by side.
        import_tasks: Import tasks that are not of the benchmark, which runs the code of the modules
            that the data set names.
    """
    source = opened(data, import_tasks=import_tasks)
    from duobench.data import find_problems
    from duobench.data.attempts import compared

    with display("episode") as shown:
        problems = find_problems(source, workers=workers, progress=shown.tell)
    for problem in problems:
        say(f"{problem.path}: {problem.what}")
    with suppress(FileError):  # which is among the problems
        for task, each in compared(source).items():
            words = str(each)
            if words:
                say(f"{task}, {AS_NOTED}: {words}")
    episodes = counted(len(source.episodes()), "episode")
    say(f"{episodes}, {counted(len(problems), 'problem')}")
    if any(problem.is_foreign for problem in problems):
        offer_to_import(set(source.tasks), import_tasks=import_tasks)
    if problems:
        sys.exit(1)


def card(
    data: tyro.conf.Positional[Path],
    name: str = ID,
    licence: str = "apache-2.0",
    import_tasks: bool = False,
) -> None:
    """Write the card of a data set, README.md as the Hub shows it, with pictures, into its folder.

    Args:
        data: Folder of recordings or of an export in LeRobot's format, or one with several.
        name: Its id on the Hub, as commands on the card name it.
        licence: The Hub's word for what others may do with it.
        import_tasks: Import tasks that are not of the benchmark, which runs the code of the modules
            that recordings name.
    """
    load_engine()
    from duobench.data.card import write_data_card

    with advising(FOREIGN):
        say(f"Card: {write_data_card(data, name, licence, import_tasks=import_tasks)}")
    words = ["hf", "upload", name, str(data), "--repo-type", "dataset"]
    say(f"Upload: {shlex.join(words)}")


def recover(data: tyro.conf.Positional[Path]) -> None:
    """Turn what killed recordings have left into episodes that say that they were cut.

    Episodes that another process is recording at this moment are left alone.

    Args:
        data: Folder of the data set.
    """
    source = opened(data)
    found = lost = 0
    with locked(source.path):
        for partial in source.partials():
            try:
                say(str(source.recover(partial)))
                found += 1
            except (DataError, OutputError) as error:
                lost += 1
                say(str(error))
    if found:
        say(f"{counted(found, 'episode')} recovered.")
    elif not lost:
        say("There is nothing to recover.")
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

    with advising({NamesTakenError: "With --rename they get the next free numbers."}):
        count = merge_into(sources, out, rename=rename)
    again = sum(len(source.episodes()) for source in sources) - count
    same = f"; left out, as equal to one of these: {again}" if again else ""
    say(f"{counted(count, 'episode')} in {out}{same}")


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
        say(f"{counted(count, 'episode')} in {folder}")


_EPISODES, _FORM = EpisodeChoice(), ExportForm()
_ADVICE: Advice = {SeveralTasksError: "With --per-task one command does that.", **FOREIGN}


def export() -> None:
    """Write data sets in the formats that policies are trained on."""


def lerobot(
    data: tyro.conf.Positional[tuple[Path, ...]],
    out: Path,
    episodes: tyro.conf.OmitArgPrefixes[EpisodeChoice] = _EPISODES,
    export: tyro.conf.OmitArgPrefixes[ExportForm] = _FORM,
    per_task: bool = False,
    workers: int = 1,
    import_tasks: bool = False,
) -> None:
    """Export data sets to LeRobot's format; images are rendered from the recorded states.

    Images of real episodes are those that were recorded. The same command in the same folder goes
    on where it was stopped.

    Args:
        data: Folder of the data set, or of several, simulated and real ones too.
        out: Folder of the export.
        episodes: Which episodes are exported.
        export: What is exported of them, and how.
        per_task: Write one data set a task, each in a folder of its name; object states of several
            tasks need it.
        workers: Processes that render and encode side by side.
        import_tasks: Import tasks that are not of the benchmark, which runs the code of the modules
            that the data sets name.
    """
    if not data:
        raise AdvisedError("Name the folder of a data set, such as duobench record makes.")
    sources = [opened(each, episodes.tasks, import_tasks=import_tasks) for each in data]
    from duobench.data import export_lerobot
    from duobench.real.canonical import view_of

    new = taken_back(out, "duobench.json")
    with raising(out), new, advising(_ADVICE), display("frame") as shown:
        done = export_lerobot(
            sources,
            out,
            ExportOptions(**vars(episodes), **vars(export)),
            per_task=per_task,
            workers=workers,
            progress=shown.tell,
            view_of=view_of,
        )
    megabytes = sum(path.stat().st_size for path in out.rglob("*") if path.is_file()) / 1e6
    say(
        f"{counted(done.episodes, 'episode')}, {counted(done.frames, 'frame')}, "
        f"{megabytes:.1f} MB in {out}",
    )
    if done.left_out:
        say(f"Left out: {counted(done.left_out, 'episode')}, discarded, not wanted or there twice.")
    if done.eval_layouts:
        of_eval = counted(done.eval_layouts, "episode")
        say(f"{of_eval} with layouts that policies are evaluated on: train on others.")
    if done.residual is not None:
        say(f"Tool poses are missed by inverse kinematics: {done.residual}.")
