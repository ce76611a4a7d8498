from __future__ import annotations

import json
import random
from typing import Any

import pytest

from duobench.core.errors import MessageError
from duobench.core.spatial import SE3
from duobench.teleop.messages import Discard, Hands, Instruction, Keep, Recentre, Restore
from tests.teleop.operator import hand, message, said

HERE = SE3.at(0.1, 0.2, 0.3, yaw=0.4)


def test_a_message_says_where_both_hands_are() -> None:
    buttons = {"keep": False, "discard": True, "recentre": False}
    hands = said(message(7, hand(HERE, squeeze=1, trigger=0.25, buttons=buttons), None))
    assert isinstance(hands, Hands)
    left = hands.left
    assert left is not None
    assert (hands.seq, hands.right, left.squeeze, left.trigger) == (7, None, 1.0, 0.25)
    assert left.buttons.discard
    assert max(left.world_from_hand.distance(HERE)) < 1e-9


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('{"kind": "keep"}', Keep()),
        ('{"kind": "discard"}', Discard()),
        ('{"kind": "restore"}', Restore()),
        ('{"kind": "recentre"}', Recentre()),
        ('{"kind": "instruction", "text": "Würfel!"}', Instruction("Würfel!")),
    ],
)
def test_a_message_says_what_is_asked_for(text: str, expected: object) -> None:
    assert said(text) == expected


def changed(**fields: Any) -> bytes:
    """A message with a hand of which some fields are others."""
    return message(0, hand(HERE) | fields, None)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "truncated"),
        (b"[]", "object"),
        (b"null", "object"),
        (b'{"kind": "reset"}', "reset"),
        (b'{"kind": 3}', "str"),
        (b'{"kind": "keep", "all": true}', "all"),
        (b'{"kind": "hands", "sent": 1, "seq": 1}', "left"),
        (message(-1, None, None), ">= 0"),
        (message(0, None, None, sent=-1.0), "time in ms"),
        (message(0, None, None, sent=float("nan")), "malformed"),
        (message(0, None, None).replace(b"0.0", b"1e999"), "range"),
        (changed(pose=[0] * 6), "length 7"),
        (changed(pose=[0, 0, 0, "1", 0, 0, 0]), "float"),
        (changed(pose=[0, 0, 0, 1.1, 0, 0, 0]), "length one"),
        (changed(pose=[0, 0, 0, 0, 0, 0, 0]), "length one"),
        (changed(pose=[0, 0, 1e6, 1, 0, 0, 0]), "at most 100 m"),
        (changed(squeeze=1.5), "<= 1.0"),
        (changed(trigger=-0.1), ">= 0.0"),
        (changed(trigger=None), "null"),
        (changed(sure=1), "bool"),
        (changed(extra=1), "extra"),
        (changed(buttons={"eject": True}), "eject"),
        (message(0, None, None, devices=["spacemouse"]), "spacemouse"),
        (b'{"kind": "instruction", "text": "two\\nlines"}', "one line"),
        (b'{"kind": "instruction", "text": "\\u202eb"}', "one line"),
        (json.dumps({"kind": "instruction", "text": "x" * 301}).encode(), "301|300"),
        (b"[" * 4000, "refused"),
        ("\udcff", "refused"),
    ],
)
def test_what_is_no_message_is_refused(data: bytes | str, words: str) -> None:
    with pytest.raises(MessageError, match=words):
        said(data)


def test_ten_thousand_damaged_messages_raise_nothing_else() -> None:
    rng = random.Random(0)
    good = changed(squeeze=0.5)
    refused = 0
    for _ in range(10_000):
        data = bytearray(good)
        for _ in range(rng.randint(1, 6)):
            place = rng.randrange(len(data))
            match rng.randrange(3):
                case 0:
                    data[place] = rng.randrange(256)
                case 1:
                    del data[place]
                case _:
                    data[place:place] = rng.choice([b"9", b"-", b"{", b"null", b"e9", b'"'])
        try:
            said(data.decode("latin-1"))
        except MessageError:
            refused += 1
    assert refused > 5_000
