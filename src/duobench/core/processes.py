"""The pool of processes that do jobs of ours side by side: export, check, verification.

Its processes end with the one that starts them, however that ends. Policies, which are code of
others, play in processes of `evaluation.runners`: those lead a group, have a clock of their own,
and may be on another machine.
"""

import os
import signal
from collections import deque
from collections.abc import (
    Callable,
    Generator,
    Iterator,
    Sequence,
)
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

from duobench.core.errors import DataError, DuoBenchError, traceback_text
from duobench.core.machine import fill_streams, watch_parent

J = TypeVar("J")
R = TypeVar("R")
Progress = Callable[[int, int], None]
"""Told how many of how many things are done."""
MAX_DEATHS = 3
"""Processes that may end by themselves, such as for lack of memory, before the work ends."""
_LOOK_S = 0.5
"""Seconds between looks at whether all processes still live."""
_SAFE_PATH = "PYTHONSAFEPATH"
"""Variable that does what Python's option -P does."""


def run_all(
    make: Callable[[], Callable[[J], R]], jobs: Sequence[J], workers: int
) -> Generator[R, None, None]:
    """Do jobs, each exactly once; the results come as they are finished, until this is closed.

    Args:
        make: Makes what does the jobs, one after the other, in the process that does them; it can
            be pickled, and so can jobs and results.
        jobs: What to do, in the order in which it is begun.
        workers: Most processes at a time; they are new ones (`spawn`), so that a script that calls
            this needs an `if __name__ == "__main__":` guard. With 0 this process does the jobs.
    """
    if workers < 0:
        raise DataError(
            f"The number of workers is 1 or more, or 0 for this process alone; got {workers}."
        )
    if workers == 0 or not jobs:
        yield from map(make(), jobs)
    else:
        fill_streams()
        yield from _run(make, jobs, workers)


def _run(
    make: Callable[[], Callable[[J], R]], jobs: Sequence[J], workers: int
) -> Generator[R, None, None]:
    left = deque(jobs)
    deaths = 0
    members = list[_Member[J]]()
    try:
        while left or members:
            while left and len(members) < workers:
                members.append(_Member(make, left.popleft()))
            said = wait([each.connection for each in members], _LOOK_S)
            for member in list(members):
                if member.connection not in said and member.process.exitcode is None:
                    continue
                try:
                    result = member.receive()
                except EOFError as error:
                    members.remove(member)
                    left.appendleft(member.job)  # what was being done is done again
                    deaths += 1
                    if deaths == MAX_DEATHS:
                        raise DataError(
                            "A process ended in the middle of its work, with exit code "
                            f"{member.process.exitcode}. What is finished is kept; the same call "
                            "goes on from there."
                        ) from error
                    continue
                if left:
                    member.begin(left.popleft())
                else:
                    members.remove(member)
                    member.end()
                yield result
    finally:
        for member in members:
            member.end()


class _Member(Generic[J]):
    def __init__(self, make: Callable[[], Callable[[J], Any]], job: J) -> None:
        context = get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(os.getpid(), theirs, make))
        with theirs, _safe_path():
            self.process.start()
        self.begin(job)

    def begin(self, job: J) -> None:
        """Have it do a job; whether it lives is found out when it answers."""
        self.job = job
        with suppress(OSError):
            self.connection.send(job)

    def receive(self) -> Any:
        """The result of the job, or the error that it raised; an `EOFError` if it has ended."""
        try:
            result = self.connection.recv()
        except (EOFError, OSError) as error:
            self.process.join()
            raise EOFError from error
        if isinstance(result, BaseException):
            raise result
        return result

    def end(self) -> None:
        """End the process, which holds nothing that has to be put away."""
        self.process.kill()
        self.process.join()
        self.connection.close()


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


def _work(
    parent: int, connection: Connection, make: Callable[[], Callable[[Any], Any]]
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent's to handle
    watch_parent(parent, partial(os._exit, 1))
    do: Callable[[Any], Any] | None = None
    while True:
        job = connection.recv()
        try:
            do = do or make()
            connection.send(do(job))
        except DuoBenchError as error:
            connection.send(error)
        except Exception as error:  # noqa: BLE001 - a process boundary; the parent raises it
            connection.send(DataError(f"A worker failed.\n{traceback_text(error)}"))
