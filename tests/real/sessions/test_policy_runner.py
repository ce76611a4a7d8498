"""How a policy on the arms is named, and what it is told."""

import pytest

from duobench.policy.registry import PolicyName
from duobench.real.sessions.policy_runner import as_real


@pytest.mark.parametrize(
    ("name", "reference"),
    [
        ("lerobot:runs/x", "runs/x?domain=real"),
        ("lerobot:runs/x?steps=5", "runs/x?steps=5&domain=real"),
        ("lerobot:runs/x?domain=sim", "runs/x?domain=sim"),
        ("lerobot:runs/domain?steps=5", "runs/domain?steps=5&domain=real"),
        ("mine:Policy", "mine:Policy"),
        ("hold", "hold"),
    ],
)
def test_policy_is_told_that_it_plays_on_real_arms(name: str, reference: str) -> None:
    told = as_real(PolicyName.parse(name))
    assert (told.text, told.reference) == (name, reference)
