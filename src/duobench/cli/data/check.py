"""`duobench data check`: every file of a data set."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

import tyro

from duobench.cli.shared.advice import offer_to_import
from duobench.cli.shared.console import counted, say
from duobench.cli.shared.folders import AS_NOTED, open_data
from duobench.cli.shared.progress import display
from duobench.core.errors import FileError


def run(
    data: tyro.conf.Positional[Path], workers: int = 1, import_tasks: bool = False
) -> None:
    """Check every file of a data set; exit code 1 if something is wrong.

    Args:
        data: Folder of the data set.
        workers: Processes that check side by side.
        import_tasks: Import tasks that are not of the benchmark, which runs the code of the modules
            that the data set names.
    """
    source = open_data(data, import_tasks=import_tasks)
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
