import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import gammaln
from scipy.stats import binom, binomtest

from duobench.results.scores import wilson_interval
from duobench.results.statistics import (
    episodes_that_would_tell,
    holm,
    mcnemar,
    newcombe_interval,
    tango_interval,
)

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


def test_interval_ends_exactly_at_perfect_scores_and_knows_nothing_without_trials() -> None:
    assert (wilson_interval(0, 20)[0], wilson_interval(20, 20)[1]) == (0.0, 1.0)
    assert wilson_interval(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("function", "args", "expected", "error"),
    [
        # Hyper-responsive airways of 21 children before and after a transplantation: 1 only before,
        # 7 only after. Fagerland, Lydersen and Laake, "The McNemar test for binary matched-pairs
        # data", BMC Med. Res. Methodol. 13:91 (2013), and their "Recommended tests and confidence
        # intervals for paired binomial proportions", Stat. Med. 33 (2014).
        (mcnemar, (1, 7), 0.0703, 5e-5),
        (tango_interval, (1, 7, 21), (-0.517, -0.026), 5e-4),
        # Examples (a) to (g) of method 10 in Newcombe (1998), Stat. Med. 17, table II.
        (newcombe_interval, ((56, 48), (70, 80)), (0.0524, 0.3339), 5.1e-5),
        (newcombe_interval, ((9, 3), (10, 10)), (0.1705, 0.8090), 5.1e-5),
        (newcombe_interval, ((6, 2), (7, 7)), (0.0582, 0.8062), 5.1e-5),
        (newcombe_interval, ((5, 0), (56, 29)), (-0.0381, 0.1926), 5.1e-5),
        (newcombe_interval, ((0, 0), (10, 20)), (-0.1611, 0.2775), 5.1e-5),
        (newcombe_interval, ((0, 0), (10, 10)), (-0.2775, 0.2775), 5.1e-5),
        (newcombe_interval, ((10, 0), (10, 20)), (0.6791, 1.0000), 5.1e-5),
    ],
)
def test_published_example(
    function: Callable[..., object], args: tuple[object, ...], expected: object, error: float
) -> None:
    assert function(*args) == pytest.approx(expected, abs=error)


# --- against SciPy, and against their own definition ---------------------------------------------


@pytest.mark.parametrize("counts", [(0, 0), (0, 1), (3, 3), (0, 6), (12, 4), (70, 91)])
def test_mcnemar_is_a_toss_of_a_coin(counts: tuple[int, int]) -> None:
    expected = binomtest(counts[0], sum(counts)).pvalue if sum(counts) else 1.0
    assert mcnemar(*counts) == pytest.approx(expected)
    assert mcnemar(*counts) == mcnemar(*counts[::-1])


def test_holm_adjusts_the_smallest_most_and_keeps_the_order() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


# --- intervals and numbers of episodes keep what they promise ------------------------------------

EPISODES = 100


def counted(rate: np.ndarray) -> np.ndarray:
    """Probabilities of 0..EPISODES successes, one column a rate."""
    return binom.pmf(np.arange(EPISODES + 1)[:, None], EPISODES, rate)


def test_coverage_of_wilson() -> None:
    rates = (np.arange(2000) + 0.5) / 2000
    low, high = np.array([wilson_interval(k, EPISODES) for k in range(EPISODES + 1)]).T[..., None]
    coverage = np.sum(counted(rates) * ((low <= rates) & (rates <= high)), axis=0)
    assert np.mean(coverage) == pytest.approx(0.95, abs=0.01)
    assert 0.838 < np.min(coverage) < 0.841  # the dip of the page comparison
    assert np.min(coverage[(rates >= 0.05) & (rates <= 0.95)]) > 0.926


def test_coverage_of_newcombe() -> None:
    rates = (np.arange(24) + 0.5) / 24
    counts = range(EPISODES + 1)
    intervals = [[newcombe_interval((a, b), (EPISODES,) * 2) for b in counts] for a in counts]
    low, high = np.moveaxis(np.array(intervals), -1, 0)
    chances = counted(rates)
    coverage = [
        np.sum(np.outer(chances[:, i], chances[:, j])[(low <= a - b) & (a - b <= high)])
        for (i, a), (j, b) in itertools.product(enumerate(rates), repeat=2)
    ]
    assert np.mean(coverage) == pytest.approx(0.95, abs=0.01)
    assert min(coverage) > 0.90


@pytest.mark.parametrize(("episodes", "lowest"), [(20, 0.936), (100, 0.932)])
def test_coverage_of_tango(episodes: int, lowest: float) -> None:
    """Over a grid of all chances that only the first policy, and only the second one, solves it."""
    counts = [(a, b) for a in range(episodes + 1) for b in range(episodes + 1 - a)]
    low, high = np.array([tango_interval(a, b, episodes) for a, b in counts]).T
    a, b = np.array(counts).T
    ways = gammaln(episodes + 1) - sum(gammaln(n + 1) for n in (a, b, episodes - a - b))
    coverage = []
    for i, j in itertools.product(range(20), repeat=2):
        x, y = (i + 1 / 3) / 20, (j + 1 / 3) / 20
        if x + y < 1:
            rest = (episodes - a - b) * math.log(1 - x - y)
            chances = np.exp(ways + a * math.log(x) + b * math.log(y) + rest)
            coverage.append(np.sum(chances[(low <= x - y) & (x - y <= high)]))
    assert np.mean(coverage) == pytest.approx(0.95, abs=0.01)
    assert min(coverage) > lowest


@pytest.mark.parametrize(("only_a", "only_b"), [(0, 0), (20, 0), (0, 20), (3, 1)])
def test_interval_of_a_difference_has_its_mirror_and_its_limits(only_a: int, only_b: int) -> None:
    low, high = tango_interval(only_a, only_b, 20)
    assert tango_interval(only_b, only_a, 20) == pytest.approx((-high, -low))
    assert -1 <= low < high <= 1
    assert low <= (only_a - only_b) / 20 <= high


def power(episodes: int, chance_a: float, chance_b: float, level: float) -> float:
    """Probability that McNemar's exact test of a level finds a difference."""
    differing = chance_a + chance_b
    share = chance_a / differing
    found = 0.0
    for count, chance in enumerate(binom.pmf(np.arange(episodes + 1), episodes, differing)):
        won = np.arange(count + 1)
        rejects = np.array([mcnemar(int(k), count - int(k)) <= level for k in won])
        found += chance * float(np.sum(binom.pmf(won, count, share)[rejects]))
    return found


@pytest.mark.long
@pytest.mark.parametrize("level", [0.05, 0.05 / 3])
@pytest.mark.parametrize(("only_a", "only_b"), [(12, 2), (30, 10), (5, 20), (9, 0)])
def test_episodes_that_would_tell_find_the_difference_in_about_80_percent(
    only_a: int, only_b: int, level: float
) -> None:
    further = episodes_that_would_tell(only_a, only_b, 100, level=level)
    assert further is not None
    chances = only_a / 100, only_b / 100
    found = power(100 + further, *chances, level)
    assert found > 0.72
    assert found < 0.9 or further == 1


def test_episodes_that_would_tell_are_connors() -> None:
    # 20 % of the episodes differ, by 10 points: 155 of them by the formula, of which 100 are there.
    root = 1.959964 * math.sqrt(0.2) + 0.841621 * math.sqrt(0.2 - 0.1**2)
    assert episodes_that_would_tell(15, 5, 100) == math.ceil((root / 0.1) ** 2) - 100
    assert episodes_that_would_tell(90, 1, 100) == 1
    assert episodes_that_would_tell(5, 15, 100) == episodes_that_would_tell(15, 5, 100)


@pytest.mark.parametrize("counts", [(0, 0, 100), (7, 7, 100)])
def test_no_number_of_episodes_is_made_up(counts: tuple[int, int, int]) -> None:
    assert episodes_that_would_tell(*counts) is None
