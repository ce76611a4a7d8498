"""The loop that owns a model: it takes the observations that wait, and answers them together."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Any, TypeVar

from duobench.errors import PolicyError, traceback_text
from duobench.policy.batch import (
    Batching,
    BatchPolicy,
    Chunk,
    Observation,
    Session,
    answer,
    begin,
    end,
)

T = TypeVar("T")

_log = logging.getLogger(__name__)

MAX_WAITING = 256
"""Requests that may wait; more are refused, so that memory stays bounded."""


class BusyError(Exception):
    """Too many requests wait already, or the loop has ended; nothing is wrong with the policy."""


@dataclass(slots=True, eq=False)
class _Errand:
    call: Callable[[], Any]
    future: Future[Any] = field(default_factory=Future)


@dataclass(slots=True, eq=False)
class _Question:
    session: Session
    observation: Observation
    future: Future[Chunk] = field(default_factory=Future)


class InferenceLoop:
    """Answers from one thread what other threads ask.

    A batch is what waits at the moment, `batching.size` observations at most; nobody waits for
    a batch to become full.
    """

    def __init__(
        self,
        policy: BatchPolicy,
        batching: Batching,
        *,
        busy: Callable[[], AbstractContextManager[Any]] = nullcontext,
    ) -> None:
        """Make a loop; `run` runs it.

        Args:
            policy: The policy, used by the thread that calls `run` only.
            batching: How many observations are answered together.
            busy: Surrounds everything that the policy does.
        """
        self._policy = policy
        self._batching = batching
        self._busy = busy
        self._news = threading.Condition()
        self._errands: deque[_Errand] = deque()
        self._questions: deque[_Question] = deque()
        self._is_over = False

    def begin(self, instruction: str, seed: int) -> Future[Session]:
        """Begin an episode.

        Returns:
            The session, or what the policy raised, as a `PolicyError`.

        Raises:
            BusyError: If too many requests wait, or the loop has ended.
        """
        errand = _Errand(lambda: begin(self._policy, instruction, seed))
        return self._queued(errand, self._errands).future

    def act(self, session: Session, observation: Observation) -> Future[Chunk]:
        """Ask for the next actions of an episode, once its last request is answered.

        A future that is cancelled before its batch begins gives its place back.

        Returns:
            A chunk (H, n), or what the policy raised, as a `PolicyError`.

        Raises:
            BusyError: If too many requests wait, or the loop has ended.
        """
        return self._queued(_Question(session, observation), self._questions).future

    def end(self, session: Session) -> None:
        """Tell the policy, when it has time, that an episode is over."""
        with self._news:
            self._errands.append(_Errand(lambda: end(self._policy, session)))
            self._news.notify()

    def stop(self) -> None:
        """Let `run` return after the batch that it is at, and cancel the futures that wait."""
        with self._news:
            self._is_over = True
            self._news.notify()

    def run(self) -> None:
        """Answer until somebody calls `stop`."""
        while self._wait():
            while self._errands:
                errand = self._errands.popleft()
                if errand.future.set_running_or_notify_cancel():
                    self._run_errand(errand)
            if batch := self._take():
                self._answer(batch)
        for waiting in (*self._errands, *self._questions):
            waiting.future.cancel()

    def _queued(self, request: T, queue: deque[T]) -> T:
        with self._news:
            if self._is_over or len(self._questions) + len(self._errands) >= MAX_WAITING:
                what = "has ended" if self._is_over else f"has {MAX_WAITING} requests waiting"
                raise BusyError(f"The policy's server {what}.")
            queue.append(request)
            self._news.notify()
        return request

    def _wait(self) -> bool:
        """Wait for something to do; whether the loop goes on."""
        with self._news:
            self._news.wait_for(lambda: self._is_over or self._errands or self._questions)
            return not self._is_over

    def _take(self) -> list[_Question]:
        """The oldest questions that somebody still waits for, as many as a batch has."""
        batch: list[_Question] = []
        while self._questions and len(batch) < self._batching.size:
            question = self._questions.popleft()
            if question.future.set_running_or_notify_cancel():
                batch.append(question)
        return batch

    def _answer(self, batch: list[_Question]) -> None:
        """Answer a batch; if that fails, each by itself, so that one of them spoils no other."""
        sessions = [question.session for question in batch]
        observations = [question.observation for question in batch]
        try:
            with self._busy():
                chunks = answer(self._policy, sessions, observations, self._batching)
        except BaseException as error:  # noqa: BLE001 - somebody else's code
            if len(batch) == 1:
                _fail(batch[0].future, error)
                return
        else:
            for question, chunk in zip(batch, chunks, strict=True):
                question.future.set_result(chunk)
            return
        _log.warning("A batch failed; its observations are answered one by one.")
        for question in batch:
            self._answer([question])

    def _run_errand(self, errand: _Errand) -> None:
        try:
            with self._busy():
                result = errand.call()
        except BaseException as error:  # noqa: BLE001 - somebody else's code
            _fail(errand.future, error)
        else:
            errand.future.set_result(result)


def _fail(future: Future[Any], error: BaseException) -> None:
    """Give a future what was raised, `sys.exit` included, as an error of the policy."""
    future.set_exception(PolicyError(traceback_text(error).strip()))
