"""Whatever a server replies, its client raises an error in words, and costs little memory."""

from collections import Counter

import pytest

from tests.policy.serving.hostile_replies import KIBIBYTE, PEERS, peak_kib, play

COUNT = 400
MOST_MIB = 128
"""Growth that two copies of the longest hostile replies, and the threads of a server, may cause."""


@pytest.mark.parametrize("name", PEERS)
def test_hostile_replies_are_the_fault_of_somebody(name: str) -> None:
    before = peak_kib()
    outcomes = Counter(play(name, COUNT))
    assert (peak_kib() - before) / KIBIBYTE < MOST_MIB
    assert outcomes.keys() <= {"PolicyError", "MachineryError", "taken"}
    assert outcomes["PolicyError"] > COUNT / 20
    assert outcomes["MachineryError"] > COUNT / 4
    assert outcomes["taken"] < COUNT / 20
