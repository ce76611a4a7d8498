"""The error family: everything DuoBench raises on purpose derives from `DuoBenchError`.

A message says what was wrong, what was given, what would have worked, and what to try next.
"""

import difflib
import os
import re
import sys
import traceback
from collections.abc import (
    Collection,
    Iterable,
    Iterator,
    Mapping,
)
from pathlib import Path
from typing import (
    Any,
    NoReturn,
    Self,
    TypeVar,
)

V = TypeVar("V")

LONGEST_LINE = 400
"""Characters of a traceback's line that are kept."""
LONGEST_TEXT = 20_000
"""Characters of a traceback that are kept, most of them from its end."""
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_UNSAFE = re.compile(r"[\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""Characters that turn the direction of writing, so that a text reads as another one, and
surrogates."""


class DuoBenchError(Exception):
    """Base of every error that DuoBench raises on purpose."""

    @classmethod
    def from_message(cls, message: str) -> Self:
        """The error whose message was composed before, such as in another process."""
        return cls.__new__(cls, message)

    def __reduce__(self) -> tuple[Any, ...]:
        """Let an error be pickled, however its message was composed."""
        return self.from_message, (str(self),)


class AssetError(DuoBenchError):
    """A data file is missing, damaged, or not of its format."""


class UnknownNameError(DuoBenchError, LookupError):
    """A name (task, object, camera, option, policy) is not known; the message lists near misses.

    The kind is what the name should have named, such as "task"; it is the whole message where
    nothing else is given, as when an error comes from another process. The owner is what has no
    such name, where that is something.
    """

    def __init__(
        self,
        kind: str,
        name: object = None,
        known: Iterable[str] | None = None,
        owner: str = "",
    ) -> None:
        if known is None:
            super().__init__(kind)
            return
        names = sorted(known)
        near = difflib.get_close_matches(str(name), names, n=3)
        hint = f" Did you mean {' or '.join(map(repr, near))}?" if near else ""
        what = (
            f"{owner} has no {kind} {name!r}" if owner else f"Unknown {kind} {name!r}"
        )
        super().__init__(f"{what}.{hint} Known: {', '.join(names) or '(none)'}.")


class ForeignTaskError(UnknownNameError):
    """Data of others name a task from outside the benchmark, which may not be imported."""


class UnknownOptionError(UnknownNameError, TypeError):
    """A call got an option that there is not.

    Libraries that try a keyword argument and do without it, such as TorchRL, wait for a `TypeError`
    and for Python's words, "unexpected keyword argument".
    """


def check_known(
    kind: str,
    name: object,
    known: Collection[str],
) -> None:
    """Reject a name that is not known."""
    if not isinstance(name, str) or name not in known:
        raise UnknownNameError(kind, name, known)


class Named(dict[str, V]):
    """Values by name, such as bodies; an unknown name raises `UnknownNameError`.

    Args:
        kind: What has the names, for the message.
        items: What is known.
    """

    def __init__(
        self, kind: str, items: Mapping[str, V] | Iterable[tuple[str, V]] = ()
    ) -> None:
        super().__init__(items)
        self.kind = kind

    def __missing__(self, name: object) -> NoReturn:
        raise UnknownNameError(self.kind, name, self)


class ImportPathError(DuoBenchError):
    """A `module:attribute` has another form, or its module is missing or raises an error."""


class OptionError(DuoBenchError, ValueError):
    """An option of an environment has an invalid value."""


class TaskError(DuoBenchError, TypeError):
    """A task is described in a way that nothing can play or judge."""


class LayoutError(DuoBenchError):
    """A layout is incomplete, overlapping or out of reach, or none could be sampled."""


class ActionError(DuoBenchError, ValueError):
    """An action has the wrong shape or holds NaN or infinity; the environment stays usable."""


class BackendError(DuoBenchError):
    """The arms cannot go on; the episode is over."""


class SimulationError(BackendError):
    """The physics became invalid: diverged, or a buffer of the engine overflowed."""


class RenderingError(DuoBenchError):
    """No offscreen OpenGL backend works; the message says what to install."""


class PolicyError(DuoBenchError):
    """A policy does not fit the environment, or it returned something that is no action chunk."""


class PolicyFailedError(PolicyError):
    """A policy raised an error; the text is its traceback."""


class PolicyTimeoutError(PolicyError):
    """A policy took longer than its time limit."""

    @classmethod
    def of_answer(cls, limit_s: float) -> Self:
        """Error of a policy that took longer than some seconds."""
        return cls(
            f"The policy did not answer within {limit_s:g} s, its limit for one reset or act."
        )


class PolicyEndedError(PolicyError):
    """A policy's process ended by itself, more than once in the same episode."""


class CalibrationError(DuoBenchError):
    """A camera cannot be calibrated from its images."""


class LeaderError(DuoBenchError):
    """Leader arms cannot be reached, or do not give what is needed of them."""


class ServingError(DuoBenchError):
    """A policy or a page cannot be served as wanted, or a server cannot be used as described."""


class MessageError(ServingError):
    """A message from or to the other side cannot be read or sent."""


class DataError(DuoBenchError):
    """A recording or a data set cannot be read, or does not fit."""


class NamesTakenError(DataError):
    """Different episodes have the same name."""


class NoSuccessesError(DataError):
    """All that there is are failures, which are not wanted."""


class NoObjectStatesError(DataError):
    """A policy learns from where objects are, and from nothing else."""


class UnknownNumbersError(DataError):
    """Numbers of a data set have names that nothing here has."""


class SeveralTasksError(DataError):
    """Several tasks were given where only one makes sense."""


class EvaluationError(DuoBenchError):
    """A run cannot begin or go on, or a file of it cannot be read."""


class TooFewSuccessesError(EvaluationError):
    """A policy that is recorded hardly ever succeeds."""


class FileError(DuoBenchError):
    """A file of a run or of a data set is damaged, or of another version."""


class OtherRunError(DuoBenchError):
    """A folder holds something else: another run, export or data set, or files of none."""


class OutputError(DuoBenchError):
    """A file or a folder cannot be written: no room, no permission, in use."""


class GoneError(OutputError):
    """A folder was removed while it was written into."""


class LockedError(OutputError):
    """A file or a folder is locked by another process, which is writing into it."""


class VideoError(DuoBenchError):
    """A video cannot be encoded."""


class FabricationError(DuoBenchError):
    """An object cannot be printed."""


class MachineryError(EvaluationError):
    """An episode could not be played, through no fault of the policy."""


class ConnectionLostError(MachineryError):
    """The connection to a policy was lost within an episode, and its server is back."""


class UnplayedError(MachineryError):
    """Episodes could not be played: a process died in them each time, or their task failed."""

    @classmethod
    def of(cls, episodes: Mapping[str, str]) -> Self:
        """The error of episodes by their names, with why they could not be played."""
        (name, *others), why = episodes, next(iter(episodes.values()))
        what = f"{len(episodes)} episodes" if others else "1 episode"
        which = f": {'; '.join(episodes)}" if others else ""
        return cls(
            f"{what} could not be played{which}. All others are finished, and kept. {name}: {why}"
        )


class TaskFailedError(UnplayedError):
    """A task's own code raised an error; the text holds its traceback."""


def error_class(name: str) -> type[DuoBenchError]:
    """Class of the family with a name from outside; `EvaluationError` if it is unknown."""
    found = globals().get(name)
    if isinstance(found, type) and issubclass(found, DuoBenchError):
        return found
    return EvaluationError


def escaped(text: str) -> str:
    r"""Text that every file, page and terminal takes.

    Control characters (but line feeds and tabs), those that turn the direction of writing, and lone
    surrogates, which stand for bytes that are no UTF-8, are written as `\x1b`, `\u202e`, `\udcff`.
    """
    text = _CONTROL.sub(lambda found: f"\\x{ord(found[0]):02x}", text)
    return _UNSAFE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def traceback_text(error: BaseException, skip: int = 0) -> str:
    """A traceback whose files are named from the folder they were imported from.

    The text is then the same in every checkout, and tells nothing about a machine. It is escaped;
    lines that go on and on, such as those with a printed array, are cut, and so is the middle of
    a text that is too long. So many of the outermost calls are left out as `skip` says.
    """
    trace = error.__traceback__
    for _ in range(skip):
        trace = trace and trace.tb_next
    text = escaped("".join(traceback.format_exception(type(error), error, trace)))
    folders = sorted(
        {str(Path(entry).resolve()) for entry in sys.path}, key=len, reverse=True
    )
    for folder in folders:
        text = text.replace(f'File "{folder}/', 'File "')
    text = "".join(
        line if len(line) <= LONGEST_LINE else f"{line[:LONGEST_LINE]} …\n"
        for line in text.splitlines(keepends=True)
    )
    if len(text) > LONGEST_TEXT:
        first = LONGEST_TEXT // 4
        text = f"{text[:first]}\n…\n{text[first - LONGEST_TEXT :]}"
    return text


def foreign_traceback(error: BaseException) -> str:
    """Format the traceback of foreign code, without our calls that led to it.

    The text is then the same in every process and from every caller.
    """
    ours = [*_are_ours(error)]
    return traceback_text(
        error, ours.index(False) if False in ours else len(ours)
    ).strip()


def is_machinery(error: BaseException) -> bool:
    """Whether an error is a `MachineryError` of ours, not raised by foreign code."""
    return isinstance(error, MachineryError) and [*_are_ours(error)][-1:] == [True]


def _are_ours(error: BaseException) -> Iterator[bool]:
    """Whether each call that led to an error, the outermost first, is in our code."""
    package = f"{Path(__file__).parents[1]}{os.sep}"
    trace = error.__traceback__
    while trace is not None:
        yield trace.tb_frame.f_code.co_filename.startswith(package)
        trace = trace.tb_next
