"""How a policy on the arms is named, and what it is told."""

import pytest

from duobench.real.sessions.policy_runner import as_real


@pytest.mark.parametrize(
    ("name", "real"),
    [
        ("lerobot:runs/x", "lerobot:runs/x?domain=real"),
        ("lerobot:runs/x?steps=5", "lerobot:runs/x?steps=5&domain=real"),
        ("lerobot:runs/x?domain=sim", "lerobot:runs/x?domain=sim"),
        ("lerobot:runs/domain?steps=5", "lerobot:runs/domain?steps=5&domain=real"),
        ("mine:Policy", "mine:Policy"),
        ("hold", "hold"),
    ],
)
def test_policy_is_told_that_it_plays_on_real_arms(name: str, real: str) -> None:
    assert as_real(name) == real
