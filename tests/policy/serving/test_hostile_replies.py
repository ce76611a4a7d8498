"""Whatever a server replies, its client raises an error in words, and costs little memory."""

import random
import resource
import struct
from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import pytest

from duobench.core.errors import PolicyError, escaped
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.client import OpenpiPolicy
from duobench.policy.serving.vla_eval import VlaEvalPolicy
from tests.policy.serving.hostile import DTYPES, KINDS, SHAPES
from tests.policy.serving.model_server import Message, ModelServer, frame, packed
from tests.policy.serving.serving import TIMEOUT_S, foreign_server, server_at
from tests.policy.serving.test_message_format import observation

Frame = bytes | str
Chunk = dict[str, Any]

COUNT = 400
MOST_MIB = 128
"""Growth that two copies of the longest hostile replies, and the threads of a server, may cause."""
LONGEST_MESSAGE = 25_000
"""Characters of an error that people can still be shown."""
SEQS = [0, -1, 2**63, 1.5, "1", None, True, []]
PAYLOADS = [
    None, 3, "text", [], {1: 2}, [[[]]], {"actions": None}, {"actions": {}}, {},
    {"\x1b[2J": 0}, {"actions": "x" * 60_000}, {"x" * 60_000: 0},
]  # fmt: skip


def chunk(generator: random.Random) -> Chunk:
    """An array that looks like a chunk of actions, with something wrong about it."""
    array: Chunk = {"__ndarray__": True, "data": bytes(64), "dtype": "<f4", "shape": [1, 16]}
    wrong = {
        "dtype": generator.choice(DTYPES),
        "shape": generator.choice([*SHAPES, [16, 1], [1, 15], [0, 16], [1, 1, 16]]),
        "data": generator.choice([b"", bytes(63), struct.pack("<16f", *[float("nan")] * 16), None]),
        "__ndarray__": False,
    }
    name = generator.choice(list(wrong))
    return array | {name: wrong[name]}


def words(generator: random.Random) -> str:
    """Text frames: empty, long, and with what a terminal obeys."""
    return generator.choice(["", "x" * 100_000, "\x1b[2J\0", "reset successful", "{}", "ä" * 100])


def openpi_reply(generator: random.Random, _message: object) -> Frame:
    number = generator.randrange(4)
    if number == 0:
        return words(generator)
    if number == 1:
        return packed(generator.choice([{"actions": chunk(generator)}, *PAYLOADS]))
    return generator.choice(KINDS)(generator)


def vla_eval_reply(generator: random.Random, message: Message) -> Frame:
    number, seq = generator.randrange(8), message["seq"]
    kind = generator.choice(["action", "action", "error", "hello", "observation", "acti\0n", None])
    payload: Any = {"actions": chunk(generator)}
    if number == 0:
        return words(generator)
    if number == 1:
        return generator.choice(KINDS)(generator)
    if number == 2:  # hostile bytes where the payload is
        envelope = b"\x83\xa4type\xa6action\xa3seq" + packed(seq) + b"\xa7payload"
        return envelope + generator.choice(KINDS)(generator)
    if number == 3:
        seq = generator.choice([*SEQS, seq + 1, seq - 1, seq - 2])
    elif number == 4:
        payload = generator.choice(PAYLOADS)
    elif number == 5:
        kind = generator.choice([kind, 3, {}, ["action"]])
    elif number == 6:
        payload = {"error": generator.choice([None, "\x1b[2J", "x" * 60_000, 3, ["deep"] * 4000])}
        kind = "error"
    else:
        kind = "action"
    return frame(kind, payload, seq)


def openpi(generator: random.Random) -> AbstractContextManager[int]:
    return foreign_server({}, lambda message: openpi_reply(generator, message))


def vla_eval(generator: random.Random) -> AbstractContextManager[int]:
    def answer(message: Message) -> Frame:
        server.received.clear()  # what it keeps would count as memory of the client
        return vla_eval_reply(generator, message)

    server = ModelServer(answer)
    return server.running()


def peak_mib() -> float:
    """Most memory that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << 10)


@pytest.mark.slow
@pytest.mark.parametrize(("client", "served"), [(OpenpiPolicy, openpi), (VlaEvalPolicy, vla_eval)])
def test_hostile_replies_are_the_fault_of_the_policy(
    client: Callable[[RemoteServer], Any], served: Callable[..., AbstractContextManager[int]]
) -> None:
    before, outcomes = peak_mib(), Counter[str]()
    with served(random.Random(COUNT)) as port:
        policy = client(server_at(port, answer_s=TIMEOUT_S))
        for _ in range(COUNT):
            policy.reset("Do it.", 0)
            try:
                policy.act(observation((24, 32)))
                outcomes["taken"] += 1
            except PolicyError as error:
                text = str(error)
                assert 0 < len(text) < LONGEST_MESSAGE
                assert text == escaped(text)
                outcomes[type(error).__name__] += 1
        policy.close()
    assert peak_mib() - before < MOST_MIB
    assert outcomes.keys() <= {"PolicyError", "taken"}  # all of it comes from a server that lives
    assert outcomes["taken"] < COUNT / 20
