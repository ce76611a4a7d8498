"""A policy that can be given up, by itself."""

import threading

import numpy as np
import pytest

from duobench.core.errors import PolicyTimeoutError
from duobench.policy import PolicyMetadata
from duobench.policy.interruptible import GIVEN_UP, InterruptiblePolicy
from tests.web.pages import wait_until


class Slow:
    """Answers once it is let, with how often it was asked."""

    metadata = PolicyMetadata(name="slow", cameras=())
    intended_action = None

    def __init__(self) -> None:
        self.gate = threading.Semaphore(0)
        self.threads: list[int] = []

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002
        self.threads.append(threading.get_ident())

    def act(self, observation: object) -> np.ndarray:
        self.threads.append(threading.get_ident())
        if observation == "fail":
            raise ValueError("out of ideas")
        self.gate.acquire()
        return np.full(1, len(self.threads))


def give_up_soon(asked: InterruptiblePolicy, slow: Slow) -> threading.Thread:
    def give_up() -> None:
        wait_until(lambda: bool(slow.threads))
        wait_until(asked.give_up)

    thread = threading.Thread(target=give_up)
    thread.start()
    return thread


def test_answers_and_errors_come_through_from_one_thread() -> None:
    slow = Slow()
    asked = InterruptiblePolicy(slow)
    asked.reset("go", 1)
    slow.gate.release()
    assert asked.act({}) == [2]
    with pytest.raises(ValueError, match="out of ideas"):
        asked.act("fail")  # type: ignore[arg-type]
    assert len(set(slow.threads)) == 1
    assert slow.threads[0] != threading.get_ident()
    assert asked.intended_action is None
    assert not asked.give_up()  # nothing is waited for
    asked.close()


def test_late_answer_of_a_call_that_was_given_up_is_no_answer_to_the_next() -> None:
    slow = Slow()
    asked = InterruptiblePolicy(slow)
    for _ in range(2):  # the second one waits behind the first, and never begins
        thread = give_up_soon(asked, slow)
        with pytest.raises(PolicyTimeoutError, match=GIVEN_UP):
            asked.act({})
        thread.join()
    slow.gate.release(2)
    assert asked.act({}) == [2]
    asked.close()
