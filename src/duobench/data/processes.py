"""Jobs that processes do side by side; whoever starts them ends them, however it ends itself."""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import cache, partial
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any, TypeVar

from duobench.errors import DataError, DuoBenchError, traceback_text
from duobench.machine import watch_parent

J = TypeVar("J")
R = TypeVar("R")
Progress = Callable[[int, int], None]
"""Told how many of how many things are done."""
MAX_ATTEMPTS = 3
"""How often jobs are begun whose processes end by themselves, such as for lack of memory."""
_LOOK_S = 0.5
"""How often is looked whether all processes still live, in seconds."""
_SAFE_PATH = "PYTHONSAFEPATH"
"""Variable that does what Python's option -P does."""


def run_all(
    make: Callable[[], Callable[[J], R]], jobs: Sequence[J], workers: int
) -> Generator[R, None, None]:
    """Do jobs, each exactly once.

    Args:
        make: Makes what does the jobs, one after the other, in the process that does them; it can
            be pickled, and so can jobs and results.
        jobs: What to do, in the order in which it is begun.
        workers: Most processes at a time; they are new ones (`spawn`), so that a script that calls
            this needs an `if __name__ == "__main__":` guard. With 0 this process does the jobs.

    Yields:
        The results, in the order in which they are finished. Processes go on until the iterator is
        closed.

    Raises:
        DuoBenchError: A job raised it; the others end here.
        DataError: Processes ended by themselves, again and again, or something unforeseen happened
            in one.
    """
    if workers < 0:
        raise DataError(
            f"The number of workers is 1 or more, or 0 for this process alone; got {workers}."
        )
    if workers == 0 or not jobs:
        yield from map(make(), jobs)
        return
    left = deque(jobs)
    for attempt in range(1, MAX_ATTEMPTS + 1):
        try:
            yield from _run(make, left, min(workers, len(left)))
        except _DeadProcessError as death:
            if attempt == MAX_ATTEMPTS:  # before, what was being done is done again
                raise DataError(
                    f"A process ended in the middle of its work, with exit code {death.code}. What "
                    "is finished is kept; the same call goes on from there."
                ) from death
        else:
            return


class _DeadProcessError(Exception):
    """A process ended by itself."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


def _run(
    make: Callable[[], Callable[[J], R]], left: deque[J], workers: int
) -> Generator[R, None, None]:
    """Do the jobs that are left, in one pool; those that are not done when it breaks stay."""
    context, running = _Spawn(), dict[Future[R], J]()
    with _safe_path():
        pool = ProcessPoolExecutor(
            workers, context, initializer=_begin, initargs=(os.getpid(), make)
        )

    def submit(most: int) -> None:
        with _safe_path():
            for _ in range(min(most, len(left))):
                running[pool.submit(_do, left[0])] = left[0]
                left.popleft()

    try:
        submit(workers)
        while running:
            done, _ = wait(running, _LOOK_S, FIRST_COMPLETED)
            if not done and any(process.exitcode is not None for process in context.processes):
                raise BrokenProcessPool  # the pool misses the death of one that has just started
            for future in done:
                result = future.result()
                del running[future]
                with suppress(BrokenProcessPool):  # what is done already must not be lost
                    submit(1)
                yield result
        if left:
            raise BrokenProcessPool
    except BrokenProcessPool as error:
        left.extendleft(reversed(running.values()))
        pool.shutdown()  # it terminates the others
        codes = [process.exitcode for process in context.processes]
        code = next((code for code in codes if code != -signal.SIGTERM), -signal.SIGTERM)
        raise _DeadProcessError(code or 0) from error
    finally:
        for process in context.processes:
            process.kill()  # it holds nothing that has to be put away
        pool.shutdown(cancel_futures=True)


class _Spawn(SpawnContext):
    """New processes, which are known here: the library can neither kill them nor say their end."""

    def __init__(self) -> None:
        self.processes: list[SpawnProcess] = []

    def Process(  # noqa: N802 - the library's name # pyright: ignore[reportIncompatibleVariableOverride]
        self, *args: Any, **kwargs: Any
    ) -> SpawnProcess:
        """A process that is still to be started."""
        self.processes.append(SpawnProcess(*args, **kwargs))
        return self.processes[-1]


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


_made: Callable[[], Callable[[Any], Any]]
"""Gives what does the jobs of this worker, and makes it first."""


def _begin(parent: int, make: Callable[[], Callable[[Any], Any]]) -> None:
    """Prepare a worker."""
    global _made  # noqa: PLW0603 - what the library offers to a worker's jobs
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent's to handle
    watch_parent(parent, partial(os._exit, 1))
    _made = cache(make)


def _do(job: Any) -> Any:
    """Do a job in a worker."""
    try:
        return _made()(job)
    except DuoBenchError:
        raise
    except Exception as error:  # noqa: BLE001 - a process boundary; the parent raises it
        raise DataError(f"A worker failed.\n{traceback_text(error)}") from None
