"""Episodes of a session in its data set: counted, set aside where discarded, and restored."""

from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from shutil import rmtree

from duobench.core.errors import DataError
from duobench.core.files import locked, make_folder, writing
from duobench.core.types import CONTROL_HZ
from duobench.data import DataSet, Recorder, Recording
from duobench.data.attempts import Attempt, note, of_task
from duobench.data.schema import VIDEO_SUFFIX
from duobench.data.stream import check_free

SET_ASIDE = "The operator discarded it while it ran."
"""Reason of the end of an episode that is set aside, if it is restored later."""
NOTHING_DISCARDED = "There is nothing to restore."


class SessionEpisodes:
    """Episodes of one task in a data set, which one session at a time may record.

    Episodes that a killed session had discarded can be restored by the next one.

    Raises:
        LockedError: Another session records the task into the data set.
    """

    def __init__(self, env: Recorder, data: DataSet) -> None:
        self._env = env
        self._data = data
        self._task = env.task
        self._lock = ExitStack()
        self._folder = self.folder(data, env.task)
        self._lock.enter_context(locked(self._folder))
        begun = [each.episode + 1 for each in of_task(data, env.task)]
        self.next_number = max(data.next_number(env.task), 0, *begun)
        """Number of the first layout that was never begun."""
        self.discarded = data.discarded.episodes(env.task)
        """Discarded files, which can be restored; the last one last."""
        self.restored: dict[Path, str] = {}
        """Restored ones, about which is asked again, and how they ended, the first one first; files
        stay where they are until they are kept."""

    @staticmethod
    def folder(data: DataSet, task: str) -> Path:
        """Folder of a task's discarded episodes, which the session that records it has locked."""
        return data.discarded.episode(task, "0").parent

    def note(self, attempt: Attempt) -> None:
        """Write down the state of an attempt."""
        note(self._data, attempt)

    def set_aside(self) -> None:
        """Discard the episode that runs, or waits to be decided."""
        self._env.set_aside(SET_ASIDE)
        files = self._data.discarded.episodes(self._task)
        self.discarded = [path for path in files if path not in self.restored]

    def restore(self) -> str:
        """Ask again about the episode that was discarded last; return its name.

        Raises:
            DataError: Nothing was discarded, or its file cannot be read.
        """
        if not self.discarded:
            raise DataError(NOTHING_DISCARDED)
        path = self.discarded[-1]
        self.restored[path] = _described(path)
        self.discarded.pop()
        return path.stem

    def discard_asked(self) -> Path:
        """Discard again the episode that is asked about; it can be restored once more."""
        path = next(iter(self.restored))
        del self.restored[path]
        self.discarded.append(path)
        return path

    def keep_asked(self) -> str:
        """Keep the episode that is asked about; return its name.

        Raises:
            DataError: Another episode has its name; it stays discarded.
            OutputError: The files cannot be moved.
        """
        path = self.discard_asked()  # as it stays if this fails
        place = self._data.episode(self._task, path.stem)
        check_free(place)
        make_folder(place.parent)
        videos = path.parent.glob(f"{path.stem}.*{VIDEO_SUFFIX}")
        for file in (*videos, path):  # an episode has all of its videos
            with writing(place):
                file.rename(place.with_name(file.name))
        self.discarded.pop()
        for each in of_task(self._data, self._task):
            if each.episode == int(path.stem):
                note(self._data, replace(each, kept=True, error=None))
        return path.stem

    def close(self, *, forget: bool) -> None:
        """Release the task for other sessions; with `forget`, remove the discarded episodes."""
        if forget:
            rmtree(self._folder, ignore_errors=True)
            with suppress(OSError):  # other tasks have theirs there
                self._folder.parent.rmdir()
                self._folder.parent.parent.rmdir()
        self._lock.close()


def _described(path: Path) -> str:
    """An episode and how it ended, in words."""
    seconds = Recording.read_length(path) / CONTROL_HZ
    outcome = Recording.read_info(path).outcome
    if outcome is None:
        end = "unknown end"
    elif outcome.success:
        end = "solved"
    else:
        end = f"stage {outcome.stage} of {outcome.max_stage}"
    return f"episode {path.stem} ({seconds:.1f} s, {end})"
