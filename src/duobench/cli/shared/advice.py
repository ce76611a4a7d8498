"""What the command line adds to an error of the library: which of its arguments would help."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from duobench.errors import (
    DuoBenchError,
    LockedError,
    MachineryError,
    OtherRunError,
    OutputError,
    RenderingError,
    TooFewSuccessesError,
)

if TYPE_CHECKING:
    from duobench.results.folder import RunFolder


class AdvisedError(DuoBenchError):
    """An error of the library, with advice."""


KINDS = {
    "dataset.json": ("a data set", "duobench data info {}"),
    "run.json": ("an evaluation", "duobench report {}"),
    "trials.json": ("an evaluation on real arms", "duobench report {}/run"),
    "meta/info.json": ("a data set of LeRobot", "duobench train act --data {}"),
}
"""What the folders are that our verbs write, by a file in each, and a verb that takes it."""


def find_folder(folder: Path, sign: str) -> None:
    """Find out that a folder is of the kind that a verb takes.

    Args:
        folder: The folder.
        sign: The file that such a folder has, a key of `KINDS`.

    Raises:
        AdvisedError: There is no such folder, or it is of another kind; it says what would do.
    """
    if (folder / sign).exists():
        return
    if not folder.exists():
        around = folder.absolute().parent
        near = sorted(str(folder.with_name(each.parent.name)) for each in around.glob(f"*/{sign}"))
        here = f" Beside it there are: {', '.join(near)}." if near else ""
        raise AdvisedError(f"There is no folder {folder}.{here}")
    for other, (kind, verb) in KINDS.items():
        if (folder / other).exists():
            raise AdvisedError(
                f"{folder} is {kind}, not {KINDS[sign][0]}. Try: {verb.format(folder)}"
            )


def find_run(path: Path) -> None:
    """Find out that there is a run or a bundle at a path.

    Raises:
        AdvisedError: There is none; it says what would do.
    """
    if not path.is_file():
        find_folder(path, "run.json")


def relative(path: Path) -> Path:
    """A path as somebody would type it: from the working folder, where it is below that."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path


@contextmanager
def advising(advice: Callable[[DuoBenchError], str | None]) -> Iterator[None]:
    """Add advice to what the library raises in a block.

    Args:
        advice: What to say after an error, if there is anything.

    Raises:
        AdvisedError: In place of an error about which there is advice.
    """
    try:
        yield
    except DuoBenchError as error:
        if (text := advice(error)) is None:
            raise
        raise AdvisedError(f"{error} {text}") from error


def for_recording(error: DuoBenchError) -> str | None:
    """What would help after an error of recording."""
    match error:
        case OtherRunError() | LockedError():
            return "Give --out another folder."
        case OutputError() | MachineryError():
            return "The same command goes on with what is missing."
        case TooFewSuccessesError():
            return "With --keep-failures every episode is kept, and counts."
    return None


def for_evaluation(folder: RunFolder, policy: str, error: DuoBenchError) -> str | None:
    """What would help after an error of an evaluation of a policy in a folder."""
    match error:
        case OtherRunError() if folder.description.exists():
            command = next(iter(folder.commands()), "")
            other = folder.path.with_name(policy.partition(":")[0])
            such = "" if other.exists() else f", such as {relative(other)}"
            known = f"; its own command is: {command}" if command else "."
            return f"Give --out another folder{such}, or delete this one{known}"
        case OtherRunError() | LockedError():
            return "Give --out another folder."
        case OutputError():
            return "Make room, or give --out another folder; the same command goes on."
        case RenderingError():
            return "A policy without cameras needs no images: try --videos 0."
        case MachineryError():
            return (
                "The same command goes on with what is missing; with --workers 0 everything "
                "happens in one process, which shows more."
            )
    return None
