import sys

import pytest

from duobench import policy
from duobench.errors import DuoBenchError, PolicyError, UnknownNameError
from duobench.evaluation import policies
from duobench.policy.lerobot.address import Address, parse


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("runs/act", Address(checkpoint="runs/act")),
        ("user/name", Address(checkpoint="user/name")),
        (
            "a:b?steps=10&device=cuda:1&dtype=bfloat16",
            Address(checkpoint="a:b", steps=10, device="cuda:1", dtype="bfloat16"),
        ),
    ],
)
def test_a_name_says_which_checkpoint_and_how_it_runs(text: str, expected: Address) -> None:
    assert parse(text) == expected


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("", PolicyError, "lerobot:PATH_OR_ID"),
        ("?steps=3", PolicyError, "lerobot:PATH_OR_ID"),
        ("a?step=3", UnknownNameError, "Did you mean 'steps'"),
        ("a?steps=0", PolicyError, "1 or more, got '0'"),
        ("a?steps=ten", PolicyError, "1 or more, got 'ten'"),
        ("a?steps=٣", PolicyError, "1 or more"),
        ("a?device=", PolicyError, "needs one value"),
        ("a?steps=3&steps=4", PolicyError, "needs one value"),
    ],
)
def test_a_name_that_says_nothing_clear_is_rejected(
    text: str, error: type[DuoBenchError], message: str
) -> None:
    with pytest.raises(error, match=message):
        parse(text)


def test_without_lerobot_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [*sys.modules]:
        if name.startswith("duobench.policy.lerobot.policy"):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)  # as if it were not installed
    policies.PolicyChoice.parse("lerobot:runs/act")
    with pytest.raises(PolicyError, match=r"pip install 'duobench-fr3\[lerobot\]'"):
        policy.make("lerobot:runs/act")
