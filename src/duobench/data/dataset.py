"""A data set: a folder of recorded episodes."""

import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from duobench.core.errors import DataError, check_known
from duobench.core.files import (
    begin_or_continue,
    check_there,
    differences,
    lock,
    read,
    remove,
    write,
    writing,
)
from duobench.core.randomness import SUITE_VERSION
from duobench.core.versions import package_versions
from duobench.data import stream
from duobench.data.recording import Recording
from duobench.data.reviews import Reviews
from duobench.data.schema import SCHEMA, VIDEO_SUFFIX, EpisodeInfo
from duobench.tasks import catalog

DESCRIPTION = "dataset.json"
"""File that makes a folder a data set."""
EPISODES = "episodes"
"""Folder of the episodes, one folder a task in it."""
SUFFIX = ".parquet"
"""Ending of the file of a finished episode."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Description:
    """Description of a data set as a whole."""

    suite_version: str
    versions: dict[str, str]
    """Versions of the packages that it was begun with."""
    how: str = ""
    """The command that made it, if one command did."""

    def differences(self, other: "Description") -> list[str]:
        """Differences that keep its episodes out of another set: suites have their own layouts."""
        name = "suite version"
        return differences({name: self.suite_version}, {name: other.suite_version})


@dataclass(frozen=True, slots=True)
class DataSet:
    """Names in the folder of a data set."""

    path: Path
    import_tasks: bool = False
    """Whether tasks that are not of the benchmark are imported, which runs the code of the modules
    that its episodes name."""
    own_tasks: tuple[str, ...] = ()
    """Import paths of tasks that are imported in any case."""

    @staticmethod
    def open(
        path: str | Path,
        *,
        create: bool = True,
        how: str = "",
        import_tasks: bool = False,
        own_tasks: Collection[str] = (),
    ) -> "DataSet":
        """The data set in a folder.

        Args:
            path: The folder, absolute from here on.
            create: Whether to make it a data set if it is missing or empty.
            how: The command that makes it.
            import_tasks: See `DataSet`.
            own_tasks: See `DataSet`.

        Raises:
            DataError: The data set is missing, and is not to be created.
            OtherRunError: The folder holds something else, or a data set of another suite.
            FileError: Its description cannot be read, or is of another version.
            OutputError: It cannot be made.
        """
        data = DataSet(Path(path).absolute(), import_tasks, tuple(own_tasks))
        if not create and not data.description.exists():
            raise DataError(f"{data.path} holds no data set: {DESCRIPTION} is missing.")
        about = Description(
            suite_version=SUITE_VERSION, versions=package_versions(), how=how
        )
        begin_or_continue(
            data.path,
            data.description,
            about,
            SCHEMA,
            what="data set",
        )
        return data

    @property
    def description(self) -> Path:
        """Description of the whole."""
        return self.path / DESCRIPTION

    def read_description(self) -> Description:
        """Its content; a `FileError` if it cannot be read."""
        return read(self.description, Description, SCHEMA)

    def _files(self, suffix: str, task: str = "*") -> list[Path]:
        return sorted((self.path / EPISODES).glob(f"{task}/*{suffix}"))

    def episode(self, task: str, name: str) -> Path:
        """File of an episode."""
        return self.path / EPISODES / task / f"{name}{SUFFIX}"

    def partial(self, task: str, name: str) -> Path:
        """File of an episode while it is being recorded."""
        return self.episode(task, name).with_suffix(stream.SUFFIX)

    def episodes(self, task: str | None = None) -> list[Path]:
        """Files of the finished episodes, sorted by task and name."""
        return self._files(SUFFIX, task or "*")

    def episodes_of(self, tasks: Collection[str]) -> list[Path]:
        """Files of the finished episodes of some tasks, or of all if none is named.

        Raises:
            UnknownNameError: There is no episode of a task.
        """
        found, wanted = self.tasks, {catalog.id_of(task) for task in tasks}
        for task in wanted:
            check_known("task in the data set", task, found)
        return [
            path for path in self.episodes() if not wanted or path.parent.name in wanted
        ]

    def partials(self) -> list[Path]:
        """Files of episodes that are being recorded, or whose recording was killed."""
        return self._files(stream.SUFFIX)

    @property
    def tasks(self) -> list[str]:
        """Ids of the tasks that have an episode, sorted."""
        return sorted({path.parent.name for path in self.episodes()})

    def reference(self, info: EpisodeInfo) -> str:
        """Reference of the task of an episode: its id or import path.

        Raises:
            ForeignTaskError: The task is from outside the benchmark and may not be imported.
            UnknownNameError: The task is from outside the benchmark and its import path is unknown.
            ImportPathError: Its module is missing or raises an error.
            DataError: Another task is there.
        """
        for path in self.own_tasks:
            if catalog.id_of(path) == info.task:
                return path
        reference = catalog.trusted(
            info.task, info.reference, import_tasks=self.import_tasks
        )
        found = catalog.get(reference).id
        if found != info.task:
            raise DataError(f"At {reference} is the task {found!r}, not {info.task!r}.")
        return reference

    def recordings(self, task: str | None = None) -> Iterator[Recording]:
        """Read one episode after the other; a `DataError` names the file that cannot be read."""
        return map(Recording.read, self.episodes(task))

    @property
    def reviews(self) -> Reviews:
        """What was said later about its recordings, read now; see `Reviews`."""
        return Reviews(self.path)

    def videos(self) -> list[Path]:
        """Videos beside the files of episodes, finished or not, sorted by task and name."""
        return self._files(VIDEO_SUFFIX)

    def new_stream(
        self, info: EpisodeInfo, sizes: Mapping[str, int], name: str | None = None
    ) -> stream.EpisodeStream:
        """Begin the recording of an episode.

        Args:
            info: What is known about it at its start.
            sizes: Numbers of an action and of a state.
            name: Name of its file; without one it is the next free number.

        Raises:
            DataError: It is no name of a file, or as `EpisodeStream` says.
            OutputError: The file cannot be made.
        """
        check_there(self.path)
        if name is not None:
            if not re.fullmatch(r"\w[\w.-]*", name):
                raise DataError(
                    f"An episode cannot be named {name!r}. A name is letters, digits, '_', '-' and "
                    "'.', and begins with a letter, a digit or '_'."
                )
            return stream.EpisodeStream(self.episode(info.task, name), info, sizes)
        number = self.next_number(info.task)
        while True:
            with suppress(DataError):  # another process has just taken the name
                return self.new_stream(info, sizes, f"{number:05d}")
            number += 1

    def kept(self, task: str) -> int:
        """Number of kept finished episodes of a task."""
        reviews = self.reviews
        outcomes = (reviews.read_info(path).outcome for path in self.episodes(task))
        return sum(outcome is not None and outcome.kept for outcome in outcomes)

    def next_number(self, task: str) -> int:
        """The first number after those of all episodes of a task, finished, discarded or not."""
        folders = (data.episode(task, "0").parent for data in (self, self.discarded))
        names = (
            path.name.partition(".")[0] for each in folders for path in each.glob("*")
        )
        return (
            max(
                (int(name) for name in names if re.fullmatch(r"[0-9]+", name)),
                default=-1,
            )
            + 1
        )

    @property
    def discarded(self) -> "DataSet":
        """Episodes that operators discarded in sessions that go on, where no other reader looks."""
        return DataSet(self.path / "discarded")

    def add(
        self,
        task: str,
        name: str,
        content: bytes,
    ) -> Path:
        """Add an episode's file that was recorded elsewhere, in one atomic step.

        The partial file of a killed recording of the same episode is removed.
        """
        check_there(self.path)
        path, partial = self.episode(task, name), self.partial(task, name)
        write(path, content)
        remove(partial)
        return path

    def recover(self, partial: Path) -> Path:
        """Turn one of `partials` into the file of an episode that says that it was cut.

        Raises:
            DataError: Nothing of it can be read, one of its videos is missing, or another episode
                has its name; it is left as it is.
            OutputError: It is still being recorded, or the episode cannot be written.
        """
        path = partial.with_suffix(SUFFIX)
        with writing(partial), partial.open("r+b") as file:
            lock(file.fileno(), partial)
            if not path.exists():
                stream.recover(partial).write(path)
            elif stream.read_left(partial)[0].begun != Recording.read_info(path).begun:
                raise DataError(
                    f"{path} is another episode than the one that {partial.name} was to become. "
                    "Rename one of them."
                )  # else it was killed after the episode was written
            partial.unlink()
        return path
