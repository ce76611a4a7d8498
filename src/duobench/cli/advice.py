"""What the command line adds to an error of the library: which of its arguments would help."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from duobench.errors import (
    DuoBenchError,
    MachineryError,
    OtherRunError,
    OutputError,
    RenderingError,
)
from duobench.evaluation.folder import RunFolder


class AdvisedError(DuoBenchError):
    """An error of the library, with advice."""


@contextmanager
def for_evaluation(folder: RunFolder) -> Iterator[None]:
    """Add advice to what an evaluation raises.

    Args:
        folder: Its folder.

    Raises:
        AdvisedError: In place of an error about which there is advice.
    """
    try:
        yield
    except (OtherRunError, OutputError, MachineryError, RenderingError) as error:
        raise AdvisedError(f"{error} {_advice(error, folder)}") from error


@contextmanager
def for_data() -> Iterator[None]:
    """Add advice to what recording raises.

    Raises:
        AdvisedError: In place of an error about which there is advice.
    """
    try:
        yield
    except OtherRunError as error:
        raise AdvisedError(f"{error} Give --out another folder.") from error
    except (OutputError, MachineryError) as error:
        raise AdvisedError(f"{error} The same command goes on with what is missing.") from error


def _advice(error: DuoBenchError, folder: RunFolder) -> str:
    match error:
        case OtherRunError() if folder.description.exists():
            return (
                "Give --out another folder, or delete this one; its own command is: "
                f"{folder.read_run().command}"
            )
        case OtherRunError():
            return "Give --out another folder."
        case OutputError():
            return "Make room, or give --out another folder; the same command goes on."
        case RenderingError():
            return "A policy without cameras needs no images: try --videos 0."
    return (
        "The same command goes on with what is missing; with --workers 0 everything happens in one "
        "process, which shows more."
    )
