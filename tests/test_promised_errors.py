"""Errors say what they are promised to say."""

import json

import pytest

from tests.promised_errors import TRIGGERS, WORDS, words

PROMISED = json.loads(WORDS.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", PROMISED)
def test_an_error_has_its_words(name: str) -> None:
    assert words(TRIGGERS[name]) == PROMISED[name], "python -m tests.promised_errors"


def test_every_error_is_promised_and_is_one_of_ours() -> None:
    assert list(PROMISED) == list(TRIGGERS)
    for name, text in PROMISED.items():
        assert text.partition(": ")[0].endswith("Error"), name
