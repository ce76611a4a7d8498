"""Jobs that processes do side by side; whoever starts them ends them, however it ends itself."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar, cast

from duobench import errors
from duobench.errors import DataError, DuoBenchError, traceback_text

J = TypeVar("J")
R = TypeVar("R")
Progress = Callable[[int, int], None]
"""Told how many of how many things are done."""
DEATH_S = 10.0
"""How long the end of a process is waited for, in seconds."""
_SAFE_PATH = "PYTHONSAFEPATH"
"""Variable that does what Python's option -P does."""


@dataclass(frozen=True, slots=True)
class _Failure:
    """Why a job could not be done."""

    kind: str
    message: str


def run_all(make: Callable[[], Callable[[J], R]], jobs: Sequence[J], workers: int) -> Iterator[R]:
    """Do jobs, each exactly once.

    Args:
        make: Makes what does the jobs, one after the other, in the process that does them; it can
            be pickled, and so can jobs and results.
        jobs: What to do, in the order in which it is begun.
        workers: Most processes at a time; they are new ones (`spawn`), so that a script that calls
            this needs an `if __name__ == "__main__":` guard. With 0 this process does the jobs.

    Yields:
        The results, in the order in which they are finished.

    Raises:
        DuoBenchError: A job raised it; the others end here.
        DataError: A process ended by itself, or something unforeseen happened in it.
    """
    if workers < 0:
        raise DataError(
            f"The number of workers is 1 or more, or 0 for this process alone; got {workers}."
        )
    if workers == 0:
        yield from map(make(), jobs)
        return
    waiting = deque(jobs)
    processes: dict[Connection, BaseProcess] = {}
    try:
        for _ in range(min(workers, len(jobs))):
            connection, process = _start(make)
            processes[connection] = process
            _send(connection, waiting.popleft())
        while processes:
            for connection in cast("list[Connection]", wait(list(processes))):
                yield _result(connection, processes[connection])
                if waiting:
                    _send(connection, waiting.popleft())
                else:
                    _end(processes.pop(connection))
    finally:
        for process in processes.values():
            _end(process)


def _start(make: Callable[[], Callable[[Any], Any]]) -> tuple[Connection, BaseProcess]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = cast("tuple[Connection, Connection]", context.Pipe())
    process = context.Process(target=_work, args=(make, theirs), daemon=True)
    with _safe_path():
        process.start()
    theirs.close()
    return ours, process


@contextmanager
def _safe_path() -> Iterator[None]:
    """Keep files of the current folder from standing in for the standard library in processes."""
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        del os.environ[_SAFE_PATH]
        if before is not None:
            os.environ[_SAFE_PATH] = before


def _end(process: BaseProcess) -> None:
    process.kill()  # it holds nothing that has to be put away
    process.join(DEATH_S)


def _send(connection: Connection, job: Any) -> None:
    """Send a job; that a process has ended shows when its result is asked for."""
    with suppress(ConnectionError):
        connection.send(job)


def _result(connection: Connection, process: BaseProcess) -> Any:
    try:
        result = connection.recv()
    except (EOFError, ConnectionError) as error:
        process.join(DEATH_S)
        raise DataError(
            f"A process ended in the middle of its work, with exit code {process.exitcode}. What "
            "is finished is kept; the same call goes on from there."
        ) from error
    if isinstance(result, _Failure):
        kind = getattr(errors, result.kind, DataError)
        raise kind.__new__(kind, result.message)
    return result


def _work(make: Callable[[], Callable[[Any], Any]], connection: Connection) -> None:
    """What a process does until nobody wants anything of it any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent's to handle
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        do = make()
        while (job := _next(connection)) is not None:
            connection.send(do(job))
    except DuoBenchError as error:
        connection.send(_Failure(type(error).__name__, str(error)))
    except Exception as error:  # noqa: BLE001 - a process boundary; the parent raises it
        connection.send(_Failure(DataError.__name__, f"A worker failed.\n{traceback_text(error)}"))
    # Taking the interpreter down is skipped: graphics drivers have crashed there.
    os._exit(0)


def _next(connection: Connection) -> Any:
    try:
        return connection.recv()
    except EOFError:
        return None


def _end_with_parent() -> None:
    """End this process when its parent is gone, however it went."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
