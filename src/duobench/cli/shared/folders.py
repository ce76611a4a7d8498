"""Folders that commands read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from duobench.cli.shared.advice import find_folder
from duobench.cli.shared.console import say
from duobench.cli.shared.process import load_engine
from duobench.results.folder import RunReader
from duobench.tasks import catalog

if TYPE_CHECKING:
    from duobench.data import DataSet

AS_NOTED = "beside what was noted of attempts"


def open_data(
    folder: Path, tasks: tuple[str, ...] = (), *, import_tasks: bool = False
) -> DataSet:
    """Open the data set in a folder; raise an error without it, or without MuJoCo.

    Of the tasks that were named, those of one's own are imported.
    """
    find_folder(folder, "dataset.json")
    load_engine()
    from duobench.data import DataSet

    own = catalog.import_paths(tasks)
    return DataSet.open(
        folder,
        create=False,
        import_tasks=import_tasks,
        own_tasks=own,
    )


def tell_missing(reader: RunReader) -> None:
    """Say what was played and is missing now; a folder of trials that do not go on is refused."""
    from duobench.real.sessions.trials_folder import TrialsFolder

    trials, run = TrialsFolder(reader.path.parent), reader.read_run()
    is_of_trials = (
        run.is_real and trials.run.path == reader.path and trials.description.exists()
    )
    missing = trials.compared() if is_of_trials else reader.removed(run)
    if missing:
        say(missing)
