"""Worker processes that play episodes, and survive each other's deaths.

Each worker is a fresh process (spawned, so that it shares no state, thread or graphics context with
anyone) with one seat. It is handed one episode at a time over its own pipe; an end of the pipe that
closes by itself is how a death is noticed, on either side.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections import Counter, deque
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import cast

from duobench.errors import DuoBenchError, EvaluationError
from duobench.evaluation.folder import RunFolder
from duobench.evaluation.recorder import Recorder, traceback_text
from duobench.evaluation.records import read_record, write_record
from duobench.evaluation.run import Run
from duobench.evaluation.seat import Played, Seat
from duobench.evaluation.suite import Trial
from duobench.evaluation.versions import record_versions

MAX_ATTEMPTS = 3
"""How often an episode is begun before one that kills its process is recorded as failed."""
MAX_FAILED_STARTS = 3
"""Workers that die one after the other before their first episode, until the run gives up."""
PATIENCE_S = 10.0
"""How long a worker may take to close its environment before it is killed, in seconds."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Ready:
    """A worker has made its environment and its policy."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Refused:
    """A worker cannot do what is asked for, and neither could another."""

    message: str


def _work(connection: Connection, run: Run, folder: RunFolder) -> None:
    """What a worker process does until it is told to stop or its parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    try:
        seat = Seat(run, folder)
        while (trial := connection.recv()) is not None:
            seat.prepare(trial.task)
            _tell(connection, _Ready())
            _tell(connection, seat.play(trial))
        seat.close()
    except DuoBenchError as error:
        _tell(connection, _Refused(message=str(error)))
    except Exception as error:  # noqa: BLE001 - a process boundary; the parent raises it
        _tell(connection, _Refused(message=f"A worker failed.\n{traceback_text(error)}"))
    # Everything is written and closed. Taking the interpreter down is skipped: graphics drivers
    # have crashed there, and libraries complain on the error stream about what is left.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def _tell(connection: Connection, message: _Ready | _Refused | Played) -> None:
    """Tell the parent; when it is gone, so is the reason to be here."""
    try:
        connection.send(message)
    except OSError:
        os._exit(1)


def _exit_with_parent() -> None:
    """Leave at once when the parent process has died, however it died."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@contextlib.contextmanager
def _interrupt_later() -> Generator[None]:
    """Let Ctrl-C wait for the end of the block, and processes that start in it be deaf to it.

    Blocking the signal is what a child inherits. It keeps only this thread from taking the signal,
    though: any other may, and Python would still interrupt the main one in the middle of the
    block, so there the handler waits too.
    """
    # Starting the first process starts this one as well, which would unblock the signal.
    resource_tracker.ensure_running()
    missed: list[int] = []
    is_main = threading.current_thread() is threading.main_thread()
    handler = signal.getsignal(signal.SIGINT)
    if is_main:
        signal.signal(signal.SIGINT, lambda number, _frame: missed.append(number))
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        if is_main:
            signal.signal(signal.SIGINT, handler)
        if missed:
            signal.raise_signal(signal.SIGINT)


@dataclass(kw_only=True, slots=True)
class _Worker:
    """A worker as its parent sees it."""

    process: BaseProcess
    connection: Connection
    trial: Trial | None = None
    is_ready: bool = False


@dataclass(kw_only=True, slots=True)
class Pool:
    """Plays trials in worker processes."""

    run: Run
    folder: RunFolder
    workers: int
    _waiting: dict[str, deque[Trial]] = field(default_factory=dict, init=False)
    _attempts: Counter[tuple[str, int]] = field(default_factory=Counter, init=False)
    _failed_starts: int = field(default=0, init=False)
    _staff: list[_Worker] = field(default_factory=list, init=False)

    def play(self, trials: Sequence[Trial]) -> Generator[Played]:
        """Play trials, each exactly once; whatever happens, no process outlives the iteration.

        Args:
            trials: What to play; trials of a task go to as few workers as keeps all of them busy.

        Yields:
            What was played, in the order in which it was finished.

        Raises:
            EvaluationError: If a worker cannot make its environment or its policy.
        """
        for trial in trials:
            self._waiting.setdefault(trial.task.id, deque()).append(trial)
        try:
            for _ in range(min(self.workers, len(trials))):
                self._hire()
            while self._staff:
                by_connection = {worker.connection: worker for worker in self._staff}
                for connection in wait(list(by_connection)):
                    played = self._hear(by_connection[connection])  # pyright: ignore[reportArgumentType]
                    if played is not None:
                        yield played
        finally:
            for worker in self._staff:
                worker.process.kill()
                worker.process.join()
                worker.connection.close()
            self._staff.clear()

    def _hire(self) -> None:
        """Start a worker and give it its first trial, unless there is none left."""
        trial = self._next(None)
        if trial is None:
            return
        context = multiprocessing.get_context("spawn")
        ours, theirs = cast("tuple[Connection, Connection]", context.Pipe())
        process = context.Process(target=_work, args=(theirs, self.run, self.folder))
        worker = _Worker(process=process, connection=ours)
        with _interrupt_later():
            process.start()
            theirs.close()
            self._staff.append(worker)
        self._give(worker, trial)

    def _give(self, worker: _Worker, trial: Trial) -> None:
        worker.trial = trial
        # Should it have died, reading from it will tell, and the trial is dealt with there.
        with contextlib.suppress(OSError):
            worker.connection.send(trial)

    def _next(self, task_id: str | None) -> Trial | None:
        """The next trial: of the task that a worker already has, else of the one with most left."""
        left = {name: queue for name, queue in self._waiting.items() if queue}
        if not left:
            return None
        if task_id not in left:
            task_id = max(left, key=lambda name: len(left[name]))
        return left[task_id].popleft()

    def _hear(self, worker: _Worker) -> Played | None:
        """Take one message, or the news of a death."""
        try:
            message = worker.connection.recv()
        except (EOFError, OSError):
            return self._bury(worker)
        match message:
            case _Ready():
                worker.is_ready = True
                self._failed_starts = 0
                return None
            case _Refused():
                raise EvaluationError(message.message)
        trial = self._next(message.record.task)
        if trial is None:
            self._dismiss(worker)
        else:
            self._give(worker, trial)
        return message

    def _dismiss(self, worker: _Worker) -> None:
        """Let a worker go for which there is nothing left to do."""
        self._staff.remove(worker)
        with contextlib.suppress(OSError):  # it may have died since
            worker.connection.send(None)
        worker.process.join(PATIENCE_S)
        worker.process.kill()
        worker.process.join()
        worker.connection.close()

    def _bury(self, worker: _Worker) -> Played | None:
        """Replace a worker that died, and see to the episode that it was playing."""
        self._staff.remove(worker)
        worker.process.join()
        worker.connection.close()
        trial, death = worker.trial, _cause_of_death(worker.process.exitcode)
        if trial is None:
            raise AssertionError("A worker always has a trial.")
        played = None
        if not worker.is_ready:
            self._failed_starts += 1
            if self._failed_starts == MAX_FAILED_STARTS:
                raise EvaluationError(
                    f"{MAX_FAILED_STARTS} workers in a row died while they were starting, the last "
                    f"{death}. Try --workers 1, which shows what happens; duobench doctor checks "
                    "the graphics."
                )
            self._waiting[trial.task.id].appendleft(trial)
        else:
            played = self._after_death(trial, death)
        self._hire()
        return played

    def _after_death(self, trial: Trial, death: str) -> Played | None:
        """What became of an episode whose worker died: finished, to be tried again, or failed."""
        path = self.folder.record(trial.task.id, trial.episode)
        if path.exists():
            return Played(record=read_record(path), seconds=None)
        key = (trial.task.id, trial.episode)
        self._attempts[key] += 1
        if self._attempts[key] < MAX_ATTEMPTS:
            self._waiting[trial.task.id].appendleft(trial)
            return None
        record = Recorder(trial).record(
            self.run.policy,
            record_versions(renderer=None),
            error=f"The worker process died in each of {MAX_ATTEMPTS} attempts, last {death}.\n",
        )
        write_record(path, record)
        return Played(record=record, seconds=None)


def _cause_of_death(exit_code: int | None) -> str:
    """An exit code in words."""
    if exit_code is not None and exit_code < 0:
        try:
            return f"by {signal.Signals(-exit_code).name}"
        except ValueError:
            return f"by signal {-exit_code}"
    return f"with exit code {exit_code}"
