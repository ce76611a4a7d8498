import pytest
from scipy.stats import binomtest

from duobench.results.metrics import wilson_interval

COUNTS = [
    (successes, trials)
    for trials in (1, 2, 20, 97, 1000)
    for successes in sorted({0, 1, trials // 3, trials // 2, trials - 1, trials})
]


@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
def test_interval_is_that_of_scipy(confidence: float) -> None:
    for successes, trials in COUNTS:
        expected = binomtest(successes, trials).proportion_ci(confidence, method="wilson")
        interval = wilson_interval(successes, trials, confidence)
        assert interval == pytest.approx((expected.low, expected.high), abs=1e-12), (
            successes,
            trials,
        )


def test_interval_of_perfect_scores_ends_exactly_at_the_score() -> None:
    assert wilson_interval(0, 20)[0] == 0.0
    assert wilson_interval(20, 20)[1] == 1.0


def test_without_trials_nothing_is_known() -> None:
    assert wilson_interval(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("successes", "trials", "confidence"),
    [(-1, 5, 0.95), (6, 5, 0.95), (1, 5, 0.0), (1, 5, 1.0), (1, 5, 95.0)],
)
def test_impossible_counts_are_refused(successes: int, trials: int, confidence: float) -> None:
    with pytest.raises(ValueError, match="got"):
        wilson_interval(successes, trials, confidence)
