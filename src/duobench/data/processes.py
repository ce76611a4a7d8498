"""Jobs that processes do side by side; whoever starts them ends them, however it ends itself."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Protocol, TypeVar, cast

from duobench import errors
from duobench.errors import DataError, DuoBenchError, traceback_text

J_contra = TypeVar("J_contra", contravariant=True)
R_co = TypeVar("R_co", covariant=True)
SHUTDOWN_TIMEOUT_S = 10.0
"""How long a process may take to free what it holds before it is killed, in seconds."""


class Worker(Protocol[J_contra, R_co]):
    """Does one job after the other."""

    def __call__(self, job: J_contra, /) -> R_co:
        """Do a job."""
        ...

    def close(self) -> None:
        """Free everything."""
        ...


@dataclass(frozen=True, slots=True)
class _Failure:
    """Why a job could not be done."""

    kind: str
    message: str


def run_all(
    make: Callable[[], Worker[J_contra, R_co]], jobs: Sequence[J_contra], workers: int
) -> Iterator[R_co]:
    """Do jobs, each exactly once.

    Args:
        make: Makes what does the jobs, in the process that does them; found by its name there.
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
        worker = make()
        try:
            yield from map(worker, jobs)
        finally:
            worker.close()
        return
    waiting = deque(jobs)
    processes: dict[Connection, BaseProcess] = {}
    try:
        for _ in range(min(workers, len(jobs))):
            connection, process = _start(make)
            processes[connection] = process
            _send(connection, waiting.popleft())
        busy = set(processes)
        while busy:
            for connection in cast("list[Connection]", wait(list(busy))):
                yield _result(connection, processes[connection])
                if waiting:
                    _send(connection, waiting.popleft())
                else:
                    busy.remove(connection)
                    connection.close()  # which ends the process
        for process in processes.values():
            process.join(SHUTDOWN_TIMEOUT_S)
    finally:
        for process in processes.values():
            process.kill()
            process.join(SHUTDOWN_TIMEOUT_S)


def _start(make: Callable[[], Any]) -> tuple[Connection, BaseProcess]:
    """Start a process that does jobs."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = cast("tuple[Connection, Connection]", context.Pipe())
    process = context.Process(target=_work, args=(make, theirs), daemon=True)
    process.start()
    theirs.close()
    return ours, process


def _send(connection: Connection, job: Any) -> None:
    """Send a job; that a process has ended shows when its result is asked for."""
    with suppress(ConnectionError):
        connection.send(job)


def _result(connection: Connection, process: BaseProcess) -> Any:
    """What a process has sent.

    Raises:
        DuoBenchError: That it failed.
    """
    try:
        result = connection.recv()
    except (EOFError, ConnectionError) as error:
        process.join(SHUTDOWN_TIMEOUT_S)
        raise DataError(
            f"A process ended in the middle of its work, with exit code {process.exitcode}. What "
            "is finished is kept; the same call goes on from there."
        ) from error
    if isinstance(result, _Failure):
        kind = getattr(errors, result.kind, DataError)
        raise kind.__new__(kind, result.message)
    return result


def _work(make: Callable[[], Worker[Any, Any]], connection: Connection) -> None:
    """What a process does until nobody wants anything of it any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent's to handle
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        worker = make()
        while (job := _next(connection)) is not None:
            connection.send(worker(job))
    except DuoBenchError as error:
        connection.send(_Failure(type(error).__name__, str(error)))
    except Exception as error:  # noqa: BLE001 - a process boundary; the parent raises it
        connection.send(_Failure(DataError.__name__, f"A worker failed.\n{traceback_text(error)}"))
    # Taking the interpreter down is skipped: graphics drivers have crashed there.
    os._exit(0)


def _next(connection: Connection) -> Any:
    """The next job; None when there is none any more."""
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
