"""Advice of the command line after an error of the library: which of its arguments would help."""

from collections.abc import (
    Callable,
    Iterator,
    Mapping,
    Set,
)
from contextlib import contextmanager
from pathlib import Path

from duobench.cli.shared.console import say
from duobench.core.errors import (
    DuoBenchError,
    ForeignTaskError,
    GoneError,
    LockedError,
    MachineryError,
    OtherRunError,
    OutputError,
    RenderingError,
    TaskFailedError,
    TooFewSuccessesError,
)
from duobench.results.folder import RunFolder
from duobench.tasks import catalog


class AdvisedError(DuoBenchError):
    """An error of the library, with advice."""


KINDS = {
    "dataset.json": ("a data set", "duobench data info {}"),
    "run.json": ("an evaluation", "duobench report {}"),
    "trials.json": ("an evaluation on real arms", "duobench report {}/run"),
    "meta/info.json": ("a data set of LeRobot", "duobench train act --data {}"),
}
"""Kinds of folders that our commands write, by a file in each, and a command that takes it."""


def find_folder(folder: Path, sign: str) -> None:
    """Reject a folder without the file that such folders have, a key of `KINDS`."""
    if (folder / sign).exists():
        return
    if not folder.exists():
        around = folder.absolute().parent
        near = sorted(
            str(folder.with_name(each.parent.name)) for each in around.glob(f"*/{sign}")
        )
        here = f" Beside it there are: {', '.join(near)}." if near else ""
        raise AdvisedError(f"There is no folder {folder}.{here}")
    for other, (kind, verb) in KINDS.items():
        if (folder / other).exists():
            raise AdvisedError(
                f"{folder} is {kind}, not {KINDS[sign][0]}. Try: {verb.format(folder)}"
            )


def find_run(path: Path) -> None:
    """Reject a path at which there is neither a run nor a bundle, as `find_folder` does."""
    if not path.is_file():
        find_folder(path, "run.json")


_IMPORT = "With --import-tasks its tasks are imported; that runs the code of others."


def offer_to_import(tasks: Set[str], *, import_tasks: bool) -> None:
    """Say what would help where tasks are not of the benchmark, and not imported."""
    if tasks - set(catalog.names()) and not import_tasks:
        say(_IMPORT)


def relative(path: Path) -> Path:
    """Return a path as a user types it: relative to the working folder, if it lies below."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path


Advice = Mapping[type[DuoBenchError], str | Callable[[], str]]
"""Advice after an error of a class; the first class that fits counts."""

FOREIGN: Advice = {ForeignTaskError: _IMPORT}
OTHER_RUN: Advice = {OtherRunError: "Give --out another folder."}
OTHER_OUT: Advice = {**OTHER_RUN, LockedError: "Give --out another folder."}
_MEND = "\nA task that was changed needs another --out."
FOR_RECORDING: Advice = {
    **OTHER_OUT,
    TaskFailedError: _MEND,
    **dict.fromkeys(
        (OutputError, MachineryError), "The same command goes on with what is missing."
    ),
    TooFewSuccessesError: "With --keep-failures every episode is kept, and counts.",
}


@contextmanager
def advising(advice: Advice) -> Iterator[None]:
    """Add advice to what the library raises in a block."""
    try:
        yield
    except DuoBenchError as error:
        text = next(
            (text for kind, text in advice.items() if isinstance(error, kind)), None
        )
        if text is None:
            raise
        raise AdvisedError(f"{error} {text() if callable(text) else text}") from error


def for_evaluation(folder: RunFolder, policy: str) -> Advice:
    """Advice after an error of an evaluation of a policy in a folder."""

    def other_run() -> str:
        if not folder.description.exists():
            return "Give --out another folder."
        command = next(iter(folder.commands()), "")
        other = folder.path.with_name(policy.partition(":")[0])
        such = "" if other.exists() else f", such as {relative(other)}"
        known = f"; its own command is: {command}" if command else "."
        return f"Give --out another folder{such}, or delete this one{known}"

    return {
        **OTHER_OUT,
        OtherRunError: other_run,
        GoneError: "The same command plays what is missing.",
        OutputError: "Make room, or give --out another folder; the same command goes on.",
        RenderingError: "A policy without cameras needs no images: try --videos 0.",
        TaskFailedError: _MEND,
        MachineryError: "The same command goes on with what is missing; with --workers 0 "
        "everything happens in one process, which shows more.",
    }
