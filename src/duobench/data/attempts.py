"""How episodes went that were begun for a data set, those among them that it does not hold."""

from dataclasses import dataclass
from pathlib import Path

from duobench.data.dataset import DataSet
from duobench.files import encode, make_folder, read, write

ATTEMPTS, TAKES = "attempts.json", "takes"
"""What `record` has played, by which it goes on; and the folder of what people have led, one file a
task, which several sessions may add to."""
ATTEMPTS_SCHEMA = 1
SKIPPED = "Skipped before it began."
"""Why an attempt at which nobody did anything is not kept."""


@dataclass(frozen=True, kw_only=True, slots=True, order=True)
class Attempt:
    """An episode that was played or led for a data set; sorted by task and index."""

    task: str
    episode: int
    success: bool
    stage: int
    steps: int
    """Control steps until it succeeded or ended."""
    kept: bool
    error: str | None
    """The last line of the error that it failed with, or why it is not kept."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Attempts:
    """All of them, by task and index."""

    attempts: tuple[Attempt, ...] = ()
    command: str = ""
    """The command that played the last of them; empty if none did."""


def of_task(data: DataSet, task: str) -> list[Attempt]:
    """What was begun for a task, whoever acted; a `FileError` if it cannot be read."""
    paths = (data.path / ATTEMPTS, _takes(data, task))
    found = [read(path, Attempts, ATTEMPTS_SCHEMA) for path in paths if path.exists()]
    return sorted(each for listed in found for each in listed.attempts if each.task == task)


def note(data: DataSet, attempt: Attempt) -> None:
    """Note how a person's attempt goes, in place of what was noted about it before."""
    path = _takes(data, attempt.task)
    listed = read(path, Attempts, ATTEMPTS_SCHEMA).attempts if path.exists() else ()
    others = (each for each in listed if each.episode != attempt.episode)
    make_folder(path.parent)
    write(path, encode(Attempts(attempts=tuple(sorted([*others, attempt]))), ATTEMPTS_SCHEMA))


def _takes(data: DataSet, task: str) -> Path:
    return data.path / TAKES / f"{task}.json"
