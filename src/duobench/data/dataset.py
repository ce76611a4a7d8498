"""A data set: a folder of recorded episodes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from duobench.data import stream
from duobench.data.recording import Recording
from duobench.data.schema import SCHEMA, EpisodeInfo
from duobench.errors import DataError, EvaluationError
from duobench.files import encode, make_folder, read, write
from duobench.randomness import SUITE_VERSION
from duobench.versions import package_versions

DESCRIPTION = "dataset.json"
"""What makes a folder a data set."""
EPISODES = "episodes"
"""Folder of the episodes, one folder a task in it."""
SUFFIX = ".parquet"
"""Ending of the file of a finished episode."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Description:
    """What is said about a data set as a whole."""

    suite_version: str
    """Version of the benchmark's episodes."""
    versions: dict[str, str]
    """Versions of the packages that it was begun with."""
    how: str = ""
    """The command that made it, if one command did."""


@dataclass(frozen=True, slots=True)
class DataSet:
    """Names in the folder of a data set."""

    path: Path
    """The folder."""

    @staticmethod
    def open(path: str | Path, *, create: bool = True, how: str = "") -> DataSet:
        """The data set in a folder.

        Args:
            path: The folder, absolute from here on.
            create: Whether to make it a data set if it is missing or empty.
            how: The command that makes it.

        Raises:
            DataError: The folder holds something else, or a data set of another version or suite.
            OutputError: It cannot be made.
        """
        data = DataSet(Path(path).absolute())
        if data.description.exists():
            about = data.read_description()
            if about.suite_version != SUITE_VERSION:
                raise DataError(
                    f"{data.path} belongs to suite {about.suite_version}, this version has suite "
                    f"{SUITE_VERSION}: states and layouts of one mean nothing in the other."
                )
            return data
        if not create:
            raise DataError(f"{data.path} holds no data set: {DESCRIPTION} is missing.")
        if data.path.is_dir() and any(data.path.iterdir()):
            raise DataError(f"{data.path} is not empty and holds no data set: {DESCRIPTION}.")
        make_folder(data.path)
        about = Description(suite_version=SUITE_VERSION, versions=package_versions(), how=how)
        write(data.description, encode(about, SCHEMA))
        return data

    @property
    def description(self) -> Path:
        """What is said about the whole."""
        return self.path / DESCRIPTION

    def read_description(self) -> Description:
        """What is said about the whole.

        Raises:
            DataError: It cannot be read, or is of another version.
        """
        try:
            return read(self.description, Description, SCHEMA)
        except EvaluationError as error:
            raise DataError(str(error)) from error

    def episode(self, task: str, name: str) -> Path:
        """File of an episode."""
        return self.path / EPISODES / task / f"{name}{SUFFIX}"

    def partial(self, task: str, name: str) -> Path:
        """File of an episode while it is being recorded."""
        return self.episode(task, name).with_suffix(stream.SUFFIX)

    def episodes(self, task: str | None = None) -> list[Path]:
        """Files of the finished episodes, sorted by task and name."""
        return sorted((self.path / EPISODES).glob(f"{task or '*'}/*{SUFFIX}"))

    def partials(self) -> list[Path]:
        """Files of episodes that are being recorded, or whose recording was killed."""
        return sorted((self.path / EPISODES).glob(f"*/*{stream.SUFFIX}"))

    @property
    def tasks(self) -> list[str]:
        """Ids of the tasks that have an episode, sorted."""
        return sorted({path.parent.name for path in self.episodes()})

    def recordings(self, task: str | None = None) -> Iterator[Recording]:
        """Read one episode after the other.

        Raises:
            DataError: One cannot be read; the message names its file.
        """
        return map(Recording.read, self.episodes(task))

    def new_stream(
        self, info: EpisodeInfo, sizes: Mapping[str, int], name: str | None = None
    ) -> stream.EpisodeStream:
        """Begin the recording of an episode.

        Args:
            info: What is known about it at its start.
            sizes: Numbers of an action and of a state.
            name: Name of its file; without one it is the next free number.

        Raises:
            DataError: There is an episode of that name, or somebody is recording one.
        """
        if name is not None:
            return self._new_stream(info, sizes, name)
        taken = [path.stem for path in (*self.episodes(info.task), *self.partials())]
        numbers = [int(stem) for stem in taken if re.fullmatch(r"[0-9]+", stem)]
        for number in count(max(numbers, default=-1) + 1):
            try:
                return self._new_stream(info, sizes, f"{number:05d}")
            except DataError:
                continue  # another process has just taken it
        raise AssertionError("Counting never ends.")

    def _new_stream(
        self, info: EpisodeInfo, sizes: Mapping[str, int], name: str
    ) -> stream.EpisodeStream:
        path = self.episode(info.task, name)
        if path.exists():
            raise DataError(f"{path} exists already; an episode is never overwritten.")
        try:
            return stream.EpisodeStream(path, info, sizes)
        except FileExistsError as error:
            raise DataError(
                f"{error.filename} exists: the episode is being recorded by another process, or "
                "its recording was killed. Recover or delete it first."
            ) from error

    def recover(self, partial: Path) -> Path:
        """Turn what a killed recording has left into an episode that says that it was cut.

        Nobody may be recording it.

        Args:
            partial: One of `partials`.

        Returns:
            The file of the episode.

        Raises:
            DataError: Nothing of it can be read; it is left as it is.
        """
        path = partial.with_suffix(SUFFIX)
        if not path.exists():  # else it was killed after the episode was written
            stream.recover(partial).write(path)
        partial.unlink()
        return path
