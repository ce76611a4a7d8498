"""Reading a run and its records from files, wherever these lie."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from pathlib import Path

from duobench.errors import EvaluationError
from duobench.files import Readable, read
from duobench.results.records import OLDEST_RECORD_SCHEMA, RECORD_SCHEMA, EpisodeRecord
from duobench.results.run import OLDEST_RUN_SCHEMA, RUN_SCHEMA, Run
from duobench.results.suite import Episode

DESCRIPTION = "run.json"
"""The file that describes the run."""


def records_folder(task_id: str) -> str:
    """Where the records of a task lie."""
    return f"records/{task_id}"


def record_name(task_id: str, episode: int) -> str:
    """The file of an episode's record."""
    return f"{records_folder(task_id)}/{episode:05d}.json"


class RunReader(ABC):
    """A run and the records of its finished episodes, read file by file."""

    advice = ""
    """What to do about a record that cannot be read."""

    def __init__(self, path: Path) -> None:
        """Find the files now: a policy may change the working folder."""
        self.path = path.absolute()
        """What is read."""

    @abstractmethod
    def file(self, name: str) -> Readable:
        """A file by its name, whether or not there is one."""

    @abstractmethod
    def names(self, folder: str) -> Iterable[str]:
        """Names of the files in a folder, without it; none if there is no such folder."""

    def read_run(self) -> Run:
        """The description of the run.

        Raises:
            EvaluationError: If there is none.
            FileError: If it cannot be read.
        """
        return read(self.file(DESCRIPTION), Run, RUN_SCHEMA, OLDEST_RUN_SCHEMA)

    def finished(self, run: Run) -> list[Episode]:
        """The episodes of a run that have a record, in the order of the run."""
        found = []
        for place, task in enumerate(run.suite.tasks):
            stems = (name.removesuffix(".json") for name in self.names(records_folder(task.id)))
            indices = {int(stem) for stem in stems if stem.isascii() and stem.isdigit()}
            found += [
                Episode(task=task, index=index, split=run.config.split, shift=run.config.shift)
                for index in sorted(indices)
                if index in run.indices(place)
            ]
        return found

    def read_record(self, run: Run, episode: Episode) -> EpisodeRecord:
        """The record of one episode of a run.

        Raises:
            FileError: If it cannot be read.
            EvaluationError: If it is of another episode or run.
        """
        file = self.file(record_name(episode.task.id, episode.index))
        record = read(file, EpisodeRecord, RECORD_SCHEMA, OLDEST_RECORD_SCHEMA, advice=self.advice)
        if objection := run.objection(record, episode):
            raise EvaluationError(f"{file} does not belong to this run: {objection}")
        return record

    def read_records(self, run: Run) -> list[EpisodeRecord]:
        """The records of the episodes that are finished, in the order of the run.

        Raises:
            FileError: If a record cannot be read.
            EvaluationError: If a record is of another episode or run.
        """
        return [self.read_record(run, episode) for episode in self.finished(run)]
