"""What knows nothing gets nothing. `python -m benchmarks.sweep` plays the same on many seeds."""

import pytest

from benchmarks.sweep import OPEN_CLOSE, Job, play
from duobench.tasks import catalog

IDLE = ("hold", "zero", OPEN_CLOSE)
LUCK = 1
"""Moving at random may touch or pinch something now and then, and no more."""


@pytest.mark.parametrize("name", catalog.names())
def test_policies_that_know_nothing_get_nothing(name: str) -> None:
    for policy in (*IDLE, "random"):
        for outcome in play(Job(task=name, policy=policy, seeds=(0,))):
            assert outcome.stage <= (0 if policy in IDLE else LUCK), policy
            assert not outcome.success
