from __future__ import annotations

import numpy as np

from duobench.teleop.freshness import WINDOW_S, Freshness

AHEAD_MS = 7.3e8
"""What the sender's clock shows when ours is at zero: a page that has been open for a week."""
RATE = 60


def test_what_arrives_in_time_is_fresh_whatever_the_clocks_show() -> None:
    freshness, rng = Freshness(), np.random.default_rng(0)
    arrival = 0.0
    for number in range(600):
        sent = number / RATE
        arrival = max(arrival, sent + 0.002 + rng.exponential(0.01))
        assert freshness.accepts(AHEAD_MS + 1000 * sent, arrival)
    assert freshness.dropped == 0


def test_the_burst_after_a_stall_is_dropped_but_for_its_end() -> None:
    freshness = Freshness()
    for number in range(RATE):
        assert freshness.accepts(AHEAD_MS + 1000 * number / RATE, number / RATE)
    stalled = range(RATE, 5 * RATE)
    accepted = [n for n in stalled if freshness.accepts(AHEAD_MS + 1000 * n / RATE, 5.0)]
    ages = [5.0 - n / RATE for n in accepted]
    assert max(ages) <= 0.25
    assert len(accepted) + freshness.dropped == len(stalled)
    assert len(accepted) in {14, 15}
    assert freshness.accepts(AHEAD_MS + 5000, 5.0)


def test_a_sample_is_used_once() -> None:
    freshness = Freshness()
    assert freshness.accepts(100.0, 1.0)
    assert not freshness.accepts(100.0, 1.01)
    assert not freshness.accepts(90.0, 1.02)
    assert freshness.accepts(130.0, 1.03)


def test_clocks_that_drift_apart_for_an_hour_stay_fresh() -> None:
    freshness = Freshness()
    for number in range(36_000):
        now = number / 10
        assert freshness.accepts(1000 * now * (1 - 2e-4), now), now
    assert 36_000 / 10 * 2e-4 > 0.25


def test_a_sender_that_slept_is_fresh_again_after_two_windows() -> None:
    freshness = Freshness()
    assert freshness.accepts(0.0, 0.0)
    slept = 100.0
    answers = [
        freshness.accepts(1000 * (number / 10 + 0.1), slept + number / 10)
        for number in range(int(20 * WINDOW_S) + 10)
    ]
    assert not answers[int(WINDOW_S * 10) - 10]
    assert answers[-1]
