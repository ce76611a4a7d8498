"""The loop that owns a model: it takes the observations that wait, and acts on them together."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Any, TypeVar

from duobench.core.errors import (
    PolicyError,
    PolicyFailedError,
    PolicyTimeoutError,
    foreign_traceback,
    is_machinery,
)
from duobench.policy.batch import (
    Batching,
    BatchPolicy,
    Chunk,
    Observation,
    Session,
    act_together,
    begin,
    end,
)

T = TypeVar("T")

_log = logging.getLogger(__name__)

MAX_WAITING = 256
"""Requests that may wait; more are refused, so that memory stays bounded."""
PATIENCE, LONGEST_WAIT_S = 0.25, 0.25
"""Wait of a batch for the sessions of the last one: a share of the time that the last one took,
and the most in seconds. An episode is usually back within a tenth of a second, and
one call for all costs little more than one for half; if it is not back, little
is lost."""


class BusyError(Exception):
    """Too many requests wait, the loop has ended, or what the policy asks is gone.

    Nothing is wrong with the policy.
    """


class PendingChunk(Future[Chunk]):
    """A chunk (H, n) that is still to come."""

    busy_s = 0.0
    """Seconds that the policy took for the batch that it was in, once it is there."""

    def __init__(self, session: Session, observation: Observation) -> None:
        super().__init__()
        self.session, self.observation = session, observation


class InferenceLoop:
    """Lets a policy act in one thread, as other threads ask.

    A batch is what waits at the moment, `batching.size` observations at most. For the episodes that
    the last batch held the loop waits a little, so that all are in the next one; see
    `PATIENCE`.

    Args:
        policy: The policy, used by the thread that calls `run` only.
        batching: How many observations a batch has.
        busy: Surrounds everything that the policy does.
    """

    def __init__(
        self,
        policy: BatchPolicy,
        batching: Batching,
        *,
        busy: Callable[[], AbstractContextManager[Any]] = nullcontext,
    ) -> None:
        self._policy = policy
        self._batching = batching
        self._busy = busy
        self._events = threading.Condition()
        self._calls: deque[tuple[Future[Any], Callable[[], Any]]] = deque()
        self._requests: deque[PendingChunk] = deque()
        self._expected: set[int] = set()
        """Ids of the sessions of the last batch that are not back yet."""
        self._deadline = 0.0
        """Until when they are waited for."""
        self._is_over = False

    def begin(self, instruction: str, seed: int) -> Future[Session]:
        """Begin an episode: the session, or what the policy raised, as a `PolicyError`."""
        future: Future[Session] = Future()
        self._queue(
            (future, partial(begin, self._policy, instruction, seed)), self._calls
        )
        return future

    def act(self, session: Session, observation: Observation) -> PendingChunk:
        """Ask for the next chunk of an episode, once the last one is there.

        A future that is cancelled before its batch begins gives its place back. It holds a chunk
        (H, n), or what the policy raised, as a `PolicyError`; without a place it is a `BusyError`.
        """
        request = PendingChunk(session, observation)
        self._queue(request, self._requests, back=session)
        return request

    def end(self, session: Session) -> None:
        """Tell the policy, when it has time, that an episode is over."""
        with self._events:
            self._expected.discard(id(session))
            self._calls.append((Future(), partial(end, self._policy, session)))
            self._events.notify()

    def stop(self) -> None:
        """Let `run` return after the batch that it is at, and cancel the futures that wait."""
        with self._events:
            self._is_over = True
            self._events.notify()

    def run(self) -> None:
        """Act until `stop` is called."""
        while self._wait():
            while self._calls:
                future, call = self._calls.popleft()
                if future.set_running_or_notify_cancel():
                    self._call(call, future)
            if self._is_due() and (batch := self._take()):
                self._act(batch)
        for waiting in (*(future for future, _ in self._calls), *self._requests):
            waiting.cancel()

    def _queue(
        self,
        request: T,
        queue: deque[T],
        back: Session | None = None,
    ) -> None:
        with self._events:
            if self._is_over or len(self._requests) + len(self._calls) >= MAX_WAITING:
                what = (
                    "has ended"
                    if self._is_over
                    else f"has {MAX_WAITING} requests waiting"
                )
                raise BusyError(f"The policy's server {what}.")
            queue.append(request)
            self._expected.discard(id(back))
            self._events.notify()

    def _wait(self) -> bool:
        """Wait for something to do; whether the loop goes on."""
        with self._events:
            while not (
                self._is_over or self._calls or (self._requests and self._is_due())
            ):
                left = (
                    max(self._deadline - time.monotonic(), 0.0)
                    if self._requests
                    else None
                )
                self._events.wait(left)
            return not self._is_over

    def _is_due(self) -> bool:
        """Whether a batch begins now, and not a little later with more in it."""
        return (
            not self._expected
            or len(self._requests) >= self._batching.size
            or time.monotonic() >= self._deadline
        )

    def _take(self) -> list[PendingChunk]:
        """Take the oldest requests that are not cancelled, up to the size of a batch."""
        batch: list[PendingChunk] = []
        while self._requests and len(batch) < self._batching.size:
            request = self._requests.popleft()
            if request.set_running_or_notify_cancel():
                batch.append(request)
        return batch

    def _act(self, batch: list[PendingChunk]) -> None:
        """Act on a batch; if that fails, on each by itself, so that one of them spoils no other."""
        sessions = [request.session for request in batch]
        observations = [request.observation for request in batch]
        start = time.perf_counter()
        try:
            with self._busy():
                chunks = act_together(
                    self._policy, sessions, observations, self._batching
                )
        except BaseException as error:  # noqa: BLE001 - a policy's code
            if len(batch) == 1:
                _fail(batch[0], error)
                return
        else:
            busy_s = time.perf_counter() - start
            with self._events:
                self._expected = set(map(id, sessions))
                self._deadline = time.monotonic() + min(
                    PATIENCE * busy_s, LONGEST_WAIT_S
                )
            for request, chunk in zip(batch, chunks, strict=True):
                request.busy_s = busy_s
                if isinstance(chunk, PolicyError):
                    _fail(request, chunk)
                else:
                    request.set_result(chunk)
            return
        _log.warning("A batch failed; its observations are answered one by one.")
        for request in batch:
            self._act([request])

    def _call(self, call: Callable[[], Any], future: Future[Any]) -> None:
        try:
            with self._busy():
                result = call()
        except BaseException as error:  # noqa: BLE001 - a policy's code
            _fail(future, error)
        else:
            future.set_result(result)


def _fail(future: Future[Any], error: BaseException) -> None:
    """Give a future what was raised, `sys.exit` included, as an error of the policy."""
    if is_machinery(error):
        future.set_exception(BusyError(str(error)))
    elif isinstance(error, PolicyTimeoutError):
        future.set_exception(error)
    else:
        future.set_exception(PolicyFailedError(foreign_traceback(error)))
