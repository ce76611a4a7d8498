import tracemalloc
import warnings
from typing import Any

import msgpack
import numpy as np
import pytest

from duobench.core.errors import MessageError
from duobench.policy.serving.codec import pack, unpack
from tests.policy.serving.hostile import ARRAY, DTYPES, SHAPES, messages

MEBIBYTE = 1 << 20


ARRAY_HEX = (
    "84c40b5f5f6e6461727261795f5fc3c40464617461c4080000803f00000040"
    "c4056474797065a33c6634c4057368617065920102"
)
SCALAR_HEX = "83c40d5f5f6e7067656e657269635f5fc3c40464617461{}c4056474797065a3{}"


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.array([[1, 2]], np.float32), ARRAY_HEX),
        (np.float32(2), SCALAR_HEX.format("cb4000000000000000", "3c6634")),
        (np.float64(2), "cb4000000000000000"),
        (np.bool_(1), SCALAR_HEX.format("c3", "7c6231")),
    ],
    ids=repr,
)
def test_what_numpy_has_has_the_bytes_of_the_protocol(value: Any, expected: str) -> None:
    assert pack({"a": value}).hex() == f"81a161{expected}"


def test_scalar_beyond_its_dtype_is_infinite_without_a_warning() -> None:
    scalar = {b"__npgeneric__": True, b"data": 1e300, b"dtype": "<f4"}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert unpack(msgpack.packb({"a": scalar}))["a"] == np.inf


def test_array_has_keys_of_text_for_those_who_read_no_others() -> None:
    packed = pack({"a": [np.zeros((1, 2), np.float32)]}, is_text_keyed=True)
    assert msgpack.unpackb(packed) == {
        "a": [{"__ndarray__": True, "data": bytes(8), "dtype": "<f4", "shape": [1, 2]}]
    }


@pytest.mark.parametrize(
    "array",
    [
        np.arange(6, dtype=np.uint8).reshape(2, 3),
        np.arange(6, dtype=">i4"),
        np.array([True, False]),
        np.array(["left", "ä"]),
        np.array([b"x", b"yz"]),
        np.zeros((0, 3), np.float16),
        np.array(3.5),
        np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    ],
)
def test_array_comes_back_and_may_be_written(array: np.ndarray) -> None:
    back = unpack(pack({"pixels": {"head": array}}))["pixels"]["head"]
    np.testing.assert_array_equal(back, array)
    assert back.dtype == array.dtype
    assert back.flags.writeable


def test_plain_values_and_text_keys_come_back() -> None:
    message = {"a": [1, 2.5, None, True, "x", b"y"], "b": {"c": {}}}
    assert unpack(pack(message)) == message
    text_keys = {key.decode(): value for key, value in ARRAY.items()}
    np.testing.assert_array_equal(unpack(msgpack.packb({"a": text_keys}))["a"], np.zeros(16))


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
def test_other_kinds_of_arrays_are_not_read(dtype: Any) -> None:
    with pytest.raises(MessageError, match=r"are not read|came with 64 bytes"):
        unpack(msgpack.packb({"a": ARRAY | {b"dtype": dtype}}))


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_shapes_that_are_not_those_of_the_data_are_not_read(shape: Any) -> None:
    with pytest.raises(MessageError):
        unpack(msgpack.packb({"a": ARRAY | {b"shape": shape}}))


@pytest.mark.parametrize(
    "value", [np.array([None]), np.zeros(2, complex), object(), {1, 2}, 2**70, np.datetime64("now")]
)
def test_what_could_not_be_read_is_not_sent(value: object) -> None:
    with pytest.raises(MessageError, match="cannot be sent"):
        pack({"a": value})


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "cannot be read"),
        (b"\x81\xa1a" * 12 + b"\xc0", "levels deep"),
        (b"\x81\xa1a\xd4\x05x", "cannot be read"),
        (b"\x81\xa1a\xd6\xff\0\0\0\1", "cannot be read"),
        (b"\x81\x01\x02", "keys of a map"),
        (b"\x93\1\2\3", "is a map of names to values, got a list"),
        (b"\x9f" + (b"\xdc\x0f\xa0" + b"\x80" * 4000) * 15, "at most 10000 items"),
        (b"\x81\xa1a\xdb\0\1\0\1" + b"x" * 65537, "cannot be read"),
    ],
)
def test_what_is_beyond_the_limits_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(MessageError, match=message):
        unpack(data)


def test_hostile_messages_are_read_or_refused_in_bounded_memory() -> None:
    told = []
    tracemalloc.start()
    for data in messages(650):
        try:
            unpack(data)
        except MessageError as error:
            told.append(str(error))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(told) > 300
    assert max(map(len, told)) < 500
    assert peak < 64 * MEBIBYTE
