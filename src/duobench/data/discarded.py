"""Episodes that an operator has discarded, which can be restored until the session ends."""

from contextlib import ExitStack, suppress
from pathlib import Path
from shutil import rmtree

from duobench.data.dataset import DISCARDED, SUFFIX, DataSet
from duobench.data.schema import VIDEO_SUFFIX
from duobench.errors import DataError
from duobench.files import locked, make_folder, writing


class Discarded:
    """The discarded episodes of one task, whole, where no reader of the data set looks.

    They belong to one session at a time. What a killed one has left is there for the next one.

    Raises:
        LockedError: Another session records the task into the data set.
    """

    def __init__(self, data: DataSet, task: str) -> None:
        self.folder = data.path / DISCARDED / task
        self._place = data.episode(task, "_").parent
        self._lock = ExitStack()
        self._lock.enter_context(locked(self.folder))
        self.look()

    def look(self) -> None:
        """See what is there; to be called when something was set aside."""
        self.names = sorted(path.stem for path in self.folder.glob(f"*{SUFFIX}"))
        """Their names, the last one last: each has a higher number than those before."""

    def restore(self, name: str) -> Path:
        """Move one to its place among the episodes, unchanged, and say where.

        Raises:
            DataError: An episode of that name is there.
            OutputError: It cannot be moved.
        """
        place = self._place / f"{name}{SUFFIX}"
        if place.exists():
            raise DataError(f"{place} exists already; an episode is never overwritten.")
        make_folder(self._place)
        videos = self.folder.glob(f"{name}.*{VIDEO_SUFFIX}")
        for path in (*videos, self.folder / place.name):  # an episode has all of its videos
            with writing(self._place / path.name):
                path.rename(self._place / path.name)
        self.look()
        return place

    def release(self) -> None:
        """Leave them to the next session."""
        with suppress(OSError):  # it holds something
            self.folder.rmdir()
            self.folder.parent.rmdir()
        self._lock.close()

    def close(self) -> None:
        """Remove them for good."""
        with writing(self.folder):
            rmtree(self.folder, ignore_errors=True)
        self.release()
