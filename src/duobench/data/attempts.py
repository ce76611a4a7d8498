"""Attempts at episodes of a data set, also at those that it does not hold."""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from duobench.core.errors import DataError
from duobench.core.files import (
    encode,
    make_folder,
    read,
    write,
)
from duobench.core.randomness import episode_seed
from duobench.data.dataset import DataSet
from duobench.data.recording import Recording
from duobench.data.reviews import DISCARDED, Reviews
from duobench.data.schema import Actor
from duobench.data.stream import INTERRUPTED

ATTEMPTS, TAKES = "attempts.json", "takes"
"""File of the attempts of `record`, by which it goes on; and the folder of those that people led,
one file a task, which several sessions may add to."""
ATTEMPTS_SCHEMA = 1
RUN = "record.json"
"""Description of what `record` records."""
SKIPPED = "Skipped before it began."
"""Reason why an attempt without any motion is not kept."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    order=True,
)
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
    layout: int | None = field(default=None, compare=False)
    """Index of its layout in its split; None where that is the index of the episode."""
    actor: Actor | None = field(default=None, compare=False)
    """Person who led it, or program in a person's place; None where neither did."""

    @property
    def of_layout(self) -> int:
        """Index of its layout in its split."""
        return self.episode if self.layout is None else self.layout


@dataclass(frozen=True, kw_only=True, slots=True)
class Attempts:
    """All of them, by task and index."""

    attempts: tuple[Attempt, ...] = ()
    command: str = ""
    """The command that played the last of them; empty if none did."""


def of_task(data: DataSet, task: str) -> list[Attempt]:
    """Attempts that were begun for a task, by any actor; a `FileError` if it cannot be read.

    What was discarded, or kept after all, at a second look is told as it stands.
    """
    paths = (data.path / ATTEMPTS, _session_attempts(data, task))
    found = [read(path, Attempts, ATTEMPTS_SCHEMA) for path in paths if path.exists()]
    reviews = data.reviews
    return sorted(
        _judged(data, each, reviews)
        for listed in found
        for each in listed.attempts
        if each.task == task
    )


def _judged(
    data: DataSet,
    attempt: Attempt,
    reviews: Reviews,
) -> Attempt:
    """An attempt as it stands after what was said about its recording at a second look."""
    path = data.episode(attempt.task, f"{attempt.episode:05d}")
    kept = None
    with suppress(DataError):  # a file that cannot be read is found elsewhere
        kept = reviews.of(path).kept if path.exists() else None
    if kept is None or kept == attempt.kept:
        return attempt
    return replace(
        attempt,
        kept=kept,
        error=None if kept else DISCARDED,
    )


def led_tasks(data: DataSet) -> list[str]:
    """Ids of the tasks at which attempts of people were noted, sorted."""
    return sorted(path.stem for path in (data.path / TAKES).glob("*.json"))


@dataclass(frozen=True, kw_only=True, slots=True)
class Comparison:
    """Files of a task beside what was noted about attempts at it."""

    missing: tuple[Path, ...]
    """Kept episodes without a file."""
    surplus: tuple[Path, ...]
    """Files of episodes that were not noted."""
    foreign: tuple[Path, ...]
    """Files whose content does not belong to their name, so that a recording cannot continue."""

    def __str__(self) -> str:
        """Format as part of a sentence; empty without differences."""
        parts = {
            "missing": self.missing,
            "not noted": self.surplus,
            "not what their names say": self.foreign,
        }
        return "; ".join(
            f"{what} {len(paths)}: {', '.join(path.stem for path in paths)}"
            for what, paths in parts.items()
            if paths
        )


def compared(data: DataSet) -> dict[str, Comparison]:
    """Compare files and noted attempts of each task, if attempts were noted.

    Raises:
        FileError: The attempts cannot be read.
    """
    is_recorded = (data.path / ATTEMPTS).exists()
    listed = [data.path / ATTEMPTS] if is_recorded else []
    listed += sorted((data.path / TAKES).glob("*.json"))
    noted: dict[str, dict[Path, bool]] = {
        task: {} for task in data.tasks if is_recorded
    }
    keeps_failures = True
    for path in listed:
        attempts = read(path, Attempts, ATTEMPTS_SCHEMA).attempts
        if path.name == ATTEMPTS:
            keeps_failures = all(each.kept for each in attempts)
        for each in attempts:
            file = data.episode(each.task, f"{each.episode:05d}")
            known = noted.setdefault(each.task, {})
            known[file] = known.get(file, False) or each.kept
    foreign = _foreign(data, keeps_failures) if is_recorded else set[Path]()
    return {
        task: Comparison(
            missing=tuple(
                path for path in sorted(known) if known[path] and not path.exists()
            ),
            surplus=tuple(path for path in data.episodes(task) if path not in known),
            foreign=tuple(path for path in data.episodes(task) if path in foreign),
        )
        for task, known in sorted(noted.items())
    }


def _foreign(data: DataSet, keeps_failures: bool) -> set[Path]:
    """Find readable files that a recording would not have left under their names."""
    found = set[Path]()
    options = None
    for path in data.episodes():
        try:
            info = Recording.read_info(path)
        except DataError:
            continue
        outcome = info.outcome
        task = path.parent.name
        index = int(path.stem) if path.stem.isdecimal() else 0
        seed = None if info.split is None else episode_seed(task, index, info.split)
        is_kept = (
            outcome is not None
            and outcome.reason != INTERRUPTED
            and (keeps_failures or (outcome.success and not outcome.cut))
        )
        given = (info.split, info.after_success)
        options = options or given  # all episodes of a recording have the same
        actual = (path.stem, info.task, info.seed, given)
        if not is_kept or actual != (f"{index:05d}", task, seed, options):
            found.add(path)
    return found


def note(data: DataSet, attempt: Attempt) -> None:
    """Write down a person's attempt, in place of what was noted about it before."""
    path = _session_attempts(data, attempt.task)
    listed = read(path, Attempts, ATTEMPTS_SCHEMA).attempts if path.exists() else ()
    others = (each for each in listed if each.episode != attempt.episode)
    make_folder(path.parent)
    write(
        path,
        encode(Attempts(attempts=tuple(sorted([*others, attempt]))), ATTEMPTS_SCHEMA),
    )


def _session_attempts(data: DataSet, task: str) -> Path:
    return data.path / TAKES / f"{task}.json"
