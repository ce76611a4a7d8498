"""The process of a verb: it loads MuJoCo, and answers Ctrl-C.

A verb that has nothing to put away is left at once. Libraries that try optional imports swallow a
`KeyboardInterrupt`, so nothing is raised while a verb loads its libraries.
"""

import os
import signal
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import NoReturn

from duobench.core.files import SCRATCH

SIGNALLED = 128
"""Exit code after a signal, less its number: 130 after Ctrl-C, as shells use it."""
AT_LEAVING: list[Callable[[], object]] = []
"""What `leave` puts back first, such as a terminal; nothing else is put away."""
_MEMORY = Path("/dev/shm")
_STDOUT, _STDERR = 1, 2
_SHOW_CURSOR = b"\x1b[?25h"
"""Live progress hides the cursor of a terminal."""


def load_engine() -> None:
    """Import MuJoCo, with which a verb begins that needs it; see `sim.opengl.load_engine`."""
    from duobench.world.sim import opengl

    opengl.load_engine()


def leave(number: int = signal.SIGINT, _frame: FrameType | None = None) -> NoReturn:
    """End the process here and now; like after a kill, every file is whole or absent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for put_back in list(AT_LEAVING):
        with suppress(Exception):
            put_back()
    with suppress(OSError):
        if os.isatty(_STDOUT):
            os.write(_STDOUT, _SHOW_CURSOR)
        os.write(_STDERR, b"\nStopped.\n")
    os._exit(SIGNALLED + number)


def _raise(_number: int, _frame: FrameType | None) -> NoReturn:
    # Pressed again, because it was swallowed or takes long, it leaves.
    signal.signal(signal.SIGINT, leave)
    raise KeyboardInterrupt


def find_scratch(paths: Iterable[Path]) -> None:
    """Have a folder for temporary files, such as the cache of what draws figures, until the end.

    Where none of the usual ones can be written, as in a container that only reads, it lies at one
    of the paths or above it, or else in memory.
    """
    try:
        tempfile.gettempdir()
    except FileNotFoundError:
        folder = next(filter(None, map(_scratch_at, (*paths, _MEMORY))), None)
        if folder is not None:
            AT_LEAVING.append(folder.cleanup)  # else it removes itself at the end of the process
            os.environ["TMPDIR"] = tempfile.tempdir = folder.name


def _scratch_at(path: Path) -> tempfile.TemporaryDirectory[str] | None:
    above = next(each for each in (path, *path.absolute().parents) if each.is_dir())
    with suppress(OSError):
        return tempfile.TemporaryDirectory(prefix=SCRATCH, dir=above, ignore_cleanup_errors=True)
    return None


@contextmanager
def leaving_at_once() -> Iterator[None]:
    """Let Ctrl-C, or a request to terminate, end the process as long as the block lasts."""
    with _answered_by(leave, signal.SIGINT), _answered_by(leave, signal.SIGTERM):
        yield


@contextmanager
def raising(out: Path) -> Iterator[None]:
    """Let Ctrl-C raise `KeyboardInterrupt` in the block, and say that what is in `out` is kept."""
    try:
        with _answered_by(_raise, signal.SIGINT):
            yield
    except KeyboardInterrupt:
        from duobench.cli.shared.console import say

        if out.exists():
            say("What is finished is kept; the same command goes on from there.")
        raise


@contextmanager
def stopping(stop: Callable[[], None]) -> Iterator[Callable[[], None]]:
    """Let Ctrl-C, or a request to terminate, call `stop` in the block; the second one leaves.

    A lost terminal calls it too. What it gives lets the next one call `stop` again.
    """
    came: set[int] = set()

    def handle(number: int, _frame: FrameType | None) -> None:
        # A closed terminal says so twice: the second time when its shell has ended.
        signal.signal(number, signal.SIG_IGN if number == signal.SIGHUP else leave)
        if number != signal.SIGHUP:
            came.add(number)
        stop()

    def again() -> None:
        while came:
            signal.signal(came.pop(), handle)

    with ExitStack() as ending:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            ending.enter_context(_answered_by(handle, number))
        yield again


@contextmanager
def _answered_by(
    handler: Callable[[int, FrameType | None], object], number: signal.Signals
) -> Iterator[None]:
    """Handle a signal, unless it is ignored, as in the background, or not ours to handle."""
    before = signal.getsignal(number)
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or before not in (signal.default_int_handler, signal.SIG_DFL, leave):
        yield
        return
    signal.signal(number, handler)
    try:
        yield
    finally:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, before)
