"""What knows nothing gets nothing. `python -m dev.benchmarks.sweep` plays the same on many
seeds."""

import pytest

from dev.benchmarks.sweep import OPEN_CLOSE, Job, play
from duobench.tasks import catalog

SEEDS = (0,)
IDLE = ("hold", "zero", OPEN_CLOSE)
IDLE_STEPS = 150
"""Five seconds, after which the idle ones only repeat themselves."""
LUCK = 1
"""Moving at random may touch or pinch something now and then, and no more."""


@pytest.mark.slow
@pytest.mark.parametrize("policy", [*IDLE, "random"])
@pytest.mark.parametrize("name", catalog.names())
def test_policies_that_know_nothing_get_nothing(name: str, policy: str) -> None:
    horizon = IDLE_STEPS if policy in IDLE else None
    for outcome in play(Job(task=name, policy=policy, seeds=SEEDS, horizon=horizon)):
        assert outcome.stage <= (0 if policy in IDLE else LUCK), outcome.seed
        assert not outcome.success
