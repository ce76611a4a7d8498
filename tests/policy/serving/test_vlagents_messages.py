"""Observations and answers of VLAgents as text, from honest agents and from others."""

import base64
import json
import random
import struct
from typing import Any

import numpy as np
import pytest

from duobench.errors import DuoBenchError, MessageError, PolicyError
from duobench.policy import as_chunk
from duobench.policy.serving import brine, limits
from duobench.policy.serving.layout import read_layout
from duobench.policy.serving.vlagents_messages import actions_from, observation_text
from tests.policy.serving.hostile import DTYPES, SHAPES
from tests.policy.serving.test_layout import observation


def packed(array: np.ndarray) -> dict[str, Any]:
    data = base64.b64encode(array.tobytes()).decode()
    return {"__numpy__": data, "dtype": array.dtype.str, "shape": list(array.shape)}


def arm(start: float) -> dict[str, Any]:
    numbers = np.arange(start, start + 7, dtype=np.float32)
    return {"action": packed(numbers), "gripper": start + 7, "done": False, "info": {"x": [1]}}


GOOD = {"acts": [{"left": arm(0), "right": arm(8)}, {"right": arm(8), "left": arm(0)}]}


def test_acts_become_actions_left_before_right() -> None:
    np.testing.assert_array_equal(actions_from(json.dumps(GOOD)), [np.arange(16)] * 2)


def test_numbers_may_be_scalars_of_numpy_and_lists() -> None:
    arms = {
        "left": {"action": [0, 1, 2, 3, 4, 5, 6], "gripper": packed(np.array(7.0, np.float32))},
        "right": arm(8) | {"gripper": packed(np.array([15], np.int64))},
    }
    np.testing.assert_array_equal(actions_from(json.dumps({"acts": [arms]})), [np.arange(16)])


def test_observation_has_the_fields_of_vlagents_and_each_image_once() -> None:
    seen = observation()
    message = read_layout("vlagents").request(seen, "Do it.")
    told = json.loads(observation_text(message))
    assert told["language_instruction"] == "Do it."
    assert set(told["obs"]) == {"left", "right"}
    assert set(told["obs"]["right"]) == {"joints", "gripper", "tquat"}
    image = told["obs"]["left"]["cameras"]["head"]
    assert (image["dtype"], image["shape"]) == ("|u1", [224, 224, 3])
    assert base64.b64decode(image["__numpy__"]) == seen["pixels"]["head"].tobytes()


def test_what_no_observation_holds_is_not_sent() -> None:
    for value in (np.array([object()]), object(), np.array(["text"])):
        with pytest.raises(MessageError, match="cannot be sent"):
            observation_text({"x": value})


def changed(**fields: Any) -> str:
    """An answer whose last left arm has other fields."""
    acts = [*GOOD["acts"][:1], {"left": arm(0) | fields, "right": arm(8)}]
    return json.dumps({"acts": acts})


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("{}", "without any `acts`"),
        ('{"acts": []}', "without any `acts`"),
        ('{"acts": {}}', "without any `acts`"),
        ("[1]", "without any `acts`"),
        ('{"acts": [3]}', "There is: nothing"),
        (json.dumps({"acts": [{"robot": arm(0)}]}), "left has not. There is: robot"),
        (changed(gripper=None), "opening of its `gripper`"),
        (changed(action=packed(np.zeros((1, 7)))), "one number"),
        (changed(action=packed(np.zeros(6))), "left arm 7 numbers and the right one 8"),
        (changed(gripper=[1, 2]), "one number"),
        (changed(gripper="open"), "gives no numbers"),
        (changed(gripper={"a": 1}), None),
        (changed(action=[[1], [2, 3]]), "gives no numbers"),
        (changed(action=packed(np.array(["a"] * 7))), "gives no numbers"),
    ],
)
def test_answer_without_actions_of_two_arms_is_the_policys_fault(
    text: str, complaint: str | None
) -> None:
    with pytest.raises(PolicyError if complaint else MessageError, match=complaint or "keys"):
        actions_from(text)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e300, -1e300, 10**400])
def test_numbers_that_no_arm_can_reach_are_the_policys_fault(value: float) -> None:
    with pytest.raises(PolicyError):
        as_chunk(actions_from(changed(gripper=value)))


@pytest.mark.parametrize(
    "fields",
    [
        *({"dtype": dtype} for dtype in DTYPES),
        *({"shape": shape} for shape in SHAPES),
        *({"__numpy__": data} for data in ("AAA", "AAAA", "é", "AA AA==", 3, None, [])),
        {"more": 1},
        {"shape": [0, 2**62, 2**62], "__numpy__": ""},
    ],
)
def test_array_that_cannot_be_one_is_not_read(fields: dict[str, Any]) -> None:
    with pytest.raises(MessageError) as told:
        actions_from(changed(action=packed(np.zeros(7, np.float32)) | fields))
    assert len(str(told.value)) < 500


@pytest.mark.parametrize(
    "text", [None, b"{}", "", "{", '{"acts": [', "[" * 100_000, '{"acts": 1' + "0" * 5000 + "}"]
)
def test_what_is_no_json_is_not_read(text: object) -> None:
    with pytest.raises(MessageError) as told:
        actions_from(text)
    assert len(str(told.value)) < 500


def test_answers_with_any_byte_changed_or_cut_are_read_or_refused() -> None:
    generator = random.Random(0)
    text = json.dumps(GOOD)
    for number in range(2_000):
        broken = list(text[: generator.randint(1, len(text))] if number % 2 else text)
        for _ in range(generator.randint(0, 4)):
            broken[generator.randrange(len(broken))] = chr(generator.randrange(32, 1000))
        try:
            as_chunk(actions_from("".join(broken)), width=None)
        except DuoBenchError as error:
            assert len(str(error)) < 1_000  # noqa: PT017 - whichever it is


VALUES = [0, -48, 159, 160, -49, 10**30, "", "a", "abcde", "x" * 256, "é" * 300, (), (1,),
          (1, "a", (2,), ()), tuple(range(5)), tuple(range(300))]  # fmt: skip


@pytest.mark.parametrize("value", VALUES, ids=range(len(VALUES)))
def test_brine_comes_back(value: object) -> None:
    assert brine.load(brine.dump(value)) == value


def test_brine_reads_what_is_never_written() -> None:
    data = b"\x16\x02\x16" + b"\x00\x03\x04\x05\x06\x01" + b"\x18" + struct.pack("!d", 1.5)
    assert brine.load(b"\x14\x07" + data[3:]) == (None, True, False, None, None, b"", 1.5)
    assert brine.load(b"\x1b" + struct.pack("!dd", 1, 2)) == (1, 2)
    assert brine.load(b"\x19\x12\x51\x52\x00") == (1, 2, None)
    assert brine.load(b"\x1a\x10\x51") == (1,)
    with pytest.raises(MessageError, match="not float"):
        brine.dump(1.5)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x07",
        b"\xff",
        b"\x10" * 10_000,
        b"\x15\xff\xff\xff\xff" + b"\x00" * 100,
        b"\x15\x00\x01\x00\x00" + b"\x00" * (1 << 16),
        b"\x0f\xff\xff\xff\xffabc",
        b"\x08\x0a\xff",
        b"\x08\x51",
        b"\x08" * 10_000,
        b"\x17\x00\x00\x20\x00" + b"9" * 0x2000,
        b"\x16\x01x",
        b"\x16\x00",
        b"\x18abc",
        b"\x00\x00",
        b"\x19" * 10_000,
    ],
)
def test_brine_that_is_none_is_not_read(data: bytes) -> None:
    with pytest.raises(MessageError) as told:
        brine.load(data)
    assert len(str(told.value)) < 500


def test_noise_as_brine_is_read_or_refused() -> None:
    generator = random.Random(0)
    for _ in range(5_000):
        data = bytes(generator.choices(range(0x1C), k=4)) + generator.randbytes(40)
        try:
            brine.load(data)
        except MessageError as error:
            assert len(str(error)) < 500  # noqa: PT017 - it may be one, by chance
    assert limits.MAX_CALL_REPLY < limits.MAX_REPLY
