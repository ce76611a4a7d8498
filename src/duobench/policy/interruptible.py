"""A policy that is asked in a thread of its own: an answer may be waited for, or given up."""

import queue
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future, InvalidStateError, wait
from contextlib import suppress
from functools import partial
from typing import Any

from duobench.core.errors import PolicyTimeoutError
from duobench.policy.policy import Policy

PATIENCE_S = 5.0
"""Seconds without an answer after which a person is told that the policy is waited for [choice]."""
GIVEN_UP = "The policy did not answer, and the operator gave it up."


class InterruptiblePolicy:
    """Asks a policy in a thread of its own, the same one for every call.

    A policy that was given up may be busy for ever: what it is asked next waits for it, and can be
    given up as well.
    """

    def __init__(self, policy: Policy) -> None:
        self.metadata = policy.metadata
        self.on_wait: Callable[[], object] = lambda: None
        """Called every `PATIENCE_S` while an answer is waited for."""
        self._policy = policy
        self._answer: Future[Any] = Future()
        self._answer.set_result(None)
        self._calls: queue.SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None]
        self._calls = queue.SimpleQueue()
        threading.Thread(
            target=self._work,
            name="policy",
            daemon=True,
        ).start()

    def __getattr__(self, name: str) -> Any:
        """Other attributes of the policy, such as `intended_action`."""
        return getattr(self._policy, name)

    def reset(
        self,
        instruction: str,
        seed: int,
    ) -> None:
        """Begin an episode."""
        self._ask(lambda: self._policy.reset(instruction, seed))

    def act(self, observation: Mapping[str, Any]) -> Any:
        """The next actions (H, n)."""
        return self._ask(lambda: self._policy.act(observation))

    def begin_reset(
        self,
        instruction: str,
        seed: int,
    ) -> Future[Any]:
        """Begin an episode without waiting for the policy; what is asked next comes after it."""
        return self._begin(lambda: self._policy.reset(instruction, seed))

    def begin_act(self, observation: Mapping[str, Any]) -> Future[Any]:
        """Ask for the next actions (H, n), and do not wait for them."""
        return self._begin(lambda: self._policy.act(observation))

    def give_up(self) -> bool:
        """Let the call that is waited for fail, from any thread; False if none is."""
        try:
            self._answer.set_exception(PolicyTimeoutError(GIVEN_UP))
        except InvalidStateError:  # it has its answer
            return False
        return True

    def close(self) -> None:
        """Ask nothing more, so that the thread ends once the policy has answered."""
        self._calls.put(None)

    def _begin(self, call: Callable[[], Any]) -> Future[Any]:
        """Give a call to the thread."""
        self._answer = answer = Future[Any]()
        self._calls.put((answer, call))
        return answer

    def _ask(self, call: Callable[[], Any]) -> Any:
        """Give a call to the thread, and wait for its answer."""
        answer = self._begin(call)
        while not wait((answer,), PATIENCE_S).done:
            self.on_wait()
        return answer.result()

    def _work(self) -> None:
        """Make the calls one after the other, in the thread."""
        while (asked := self._calls.get()) is not None:
            answer, call = asked
            if answer.done():  # given up before it began
                continue
            try:
                settle = partial(answer.set_result, call())
            except BaseException as error:  # noqa: BLE001 - raised where the answer is awaited
                settle = partial(answer.set_exception, error)
            with suppress(InvalidStateError):  # given up meanwhile
                settle()
