"""Messages that nobody should send: cut off, nested, oversized, of forbidden kinds, noise."""

import random
import struct
from collections.abc import Callable, Iterator
from typing import Any

import msgpack

ARRAY = {b"__ndarray__": True, b"data": bytes(64), b"dtype": "<f4", b"shape": [16]}
GOOD = {
    "agent_pos": ARRAY,
    "prompt": "Do it.",
    "pixels": {"head": ARRAY | {b"dtype": "|u1", b"shape": [64]}},
}
DTYPES = [
    "|O",
    "|V4",
    "<c8",
    "<M8[s]",
    "f4,f4",
    "(2,)f4",
    "O",
    "<f3",
    "|S0",
    "<U999999",
    "",
    3,
    None,
]
SHAPES: list[Any] = [
    [17], [-16], [2**40, 2**40], [1] * 40, [True, 16], 16, None, [16.0], ["16"], [0, -1],
]  # fmt: skip
SEEDS = [-1, 1.5, "x", None, 2**63, [], True, {}, float("nan")]


def nested(generator: random.Random) -> bytes:
    """Deep; the last kind also promises 4,096 items on every level."""
    depth = generator.choice([10, 100, 1000, 100_000])
    (kind,) = generator.choices([b"\x91", b"\x81\xa1a", b"\xdc\x10\x00"], [8, 8, 1])
    return kind * depth


def oversized(generator: random.Random) -> bytes:
    """Headers that promise more than there is, or more than is read."""
    size = generator.choice([5_000, 2**31, 2**32 - 1])
    head = generator.choice([0xC6, 0xDB, 0xDD, 0xDF])
    return b"\x81\xa1a" + bytes([head]) + struct.pack(">I", size) + b"\x90" * 5_000


def crowded(generator: random.Random) -> bytes:
    """Many small things."""
    return b"\x9f" + (b"\xdc\x0f\xa0" + generator.choice([b"\x80", b"\x90", b"\xc0"]) * 4000) * 15


def mutated(generator: random.Random) -> bytes:
    data = bytearray(msgpack.packb(GOOD))
    for _ in range(generator.randint(1, 8)):
        data[generator.randrange(len(data))] = generator.randrange(256)
    return bytes(data)


def of_forbidden_kind(generator: random.Random) -> bytes:
    return msgpack.packb({"agent_pos": ARRAY | {b"dtype": generator.choice(DTYPES)}})


def of_wrong_shape(generator: random.Random) -> bytes:
    return msgpack.packb({"agent_pos": ARRAY | {b"shape": generator.choice(SHAPES)}})


def not_a_number(generator: random.Random) -> bytes:
    value = generator.choice([float("nan"), float("inf"), 1e300])
    data = struct.pack("<15f", *range(15)) + b"\0\0\xc0\x7f"
    return msgpack.packb({"agent_pos": ARRAY | {b"data": data}, "actions": [[value] * 16]})


def extension(generator: random.Random) -> bytes:
    value = generator.choice([msgpack.Timestamp(1), msgpack.ExtType(5, bytes(4))])
    return msgpack.packb({"agent_pos": value})


def misused(generator: random.Random) -> bytes:
    """Fields of the protocol with values that they cannot have."""
    name = generator.choice(["seed", "prompt", "session_id", "endpoint"])
    value = generator.choice([seed for seed in SEEDS if seed != 2**63])
    return msgpack.packb({**GOOD, name: value}, use_bin_type=True)


def not_a_map(generator: random.Random) -> bytes:
    return msgpack.packb(generator.choice([3, "text", [], None, ARRAY, {1: 2}, {b"\xff": 1}]))


def scalar(generator: random.Random) -> bytes:
    data = generator.choice([[1], {}, "x", 2**63, None, b"x"])
    dtype = generator.choice(["<i4", "|O", "<U4", "|b1", "|u1"])
    return msgpack.packb({"agent_pos": {b"__npgeneric__": True, b"data": data, b"dtype": dtype}})


def truncated(generator: random.Random) -> bytes:
    data = msgpack.packb(GOOD)
    return data[: generator.randrange(len(data))]


def noise(generator: random.Random) -> bytes:
    return generator.randbytes(generator.randint(0, 200))


KINDS: tuple[Callable[[random.Random], bytes], ...] = (
    nested, oversized, crowded, mutated, of_forbidden_kind, of_wrong_shape, not_a_number, extension,
    misused, not_a_map, scalar, truncated, noise,
)  # fmt: skip


def messages(count: int) -> Iterator[bytes]:
    generator = random.Random(0)
    for number in range(count):
        yield KINDS[number % len(KINDS)](generator)
