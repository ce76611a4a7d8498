"""Replies that no policy's server should give, played to the clients.

`python -m tests.policy.serving.hostile_replies 20000` plays that many, and says how it went.
"""

import random
import resource
import struct
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

from duobench.errors import DuoBenchError, escaped
from duobench.policy import Policy
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.client import OpenpiPolicy
from duobench.policy.serving.vla_eval import VlaEvalPolicy
from tests.policy.serving.hostile import DTYPES, KINDS, SHAPES
from tests.policy.serving.model_server import Message, ModelServer, frame, packed
from tests.policy.serving.serving import TIMEOUT_S, foreign_server
from tests.policy.serving.test_message_format import observation

Frame = bytes | str
Chunk = dict[str, Any]

KIBIBYTE = 1 << 10
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


@dataclass(frozen=True, kw_only=True)
class Peer:
    """A client, and a server that gives it nothing but hostile replies."""

    client: Callable[[RemoteServer], Policy]
    serve: Callable[[random.Random], AbstractContextManager[int]]


def _openpi(generator: random.Random) -> AbstractContextManager[int]:
    return foreign_server({}, lambda message: openpi_reply(generator, message))


def _vla_eval(generator: random.Random) -> AbstractContextManager[int]:
    def answer(message: Message) -> Frame:
        server.received.clear()  # what it keeps would count as memory of the client
        return vla_eval_reply(generator, message)

    server = ModelServer(answer)
    return server.running()


PEERS = {
    "openpi": Peer(client=OpenpiPolicy, serve=_openpi),
    "vla-eval": Peer(client=VlaEvalPolicy, serve=_vla_eval),
}


def play(name: str, count: int) -> Iterator[str]:
    """Play replies to a client; the name of the error that each is, or "taken".

    Raises:
        AssertionError: If an error cannot be shown to people.
    """
    seen = observation((24, 32))
    peer = PEERS[name]
    with peer.serve(random.Random(count)) as port:
        server = RemoteServer(url=f"ws://127.0.0.1:{port}", wait_s=0.0, answer_s=TIMEOUT_S)
        policy = peer.client(server)
        for _ in range(count):
            policy.reset("Do it.", 0)
            try:
                policy.act(seen)
            except DuoBenchError as error:
                text = str(error)
                assert 0 < len(text) < LONGEST_MESSAGE
                assert text == escaped(text)
                yield type(error).__name__
            else:
                yield "taken"
        policy.close()  # pyright: ignore[reportAttributeAccessIssue] - both clients have it


def peak_kib() -> int:
    """Most memory that this process has had, in KiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main() -> None:
    """Play as many replies to each client as the command line says."""
    count = int(sys.argv[1])
    for name in PEERS:
        Counter(play(name, 200))
        before, start = peak_kib(), time.perf_counter()
        outcomes = Counter(play(name, count))
        seconds, growth = time.perf_counter() - start, (peak_kib() - before) / KIBIBYTE
        sys.stdout.write(
            f"{name}: {count} replies in {seconds:.1f} s, peak memory +{growth:.1f} MiB, "
            f"{dict(outcomes)}\n"
        )


if __name__ == "__main__":
    main()
