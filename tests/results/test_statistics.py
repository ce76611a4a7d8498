import itertools
import math
from collections.abc import Callable, Sequence
from fractions import Fraction

import numpy as np
import pytest
from scipy.special import gammaln
from scipy.stats import barnard_exact, binom, binomtest, permutation_test

from dev.benchmarks.looks import LEAST_POWER, LOOKS, MOST_CLAIMS, claims
from duobench.results import statistics
from duobench.results.scores import wilson_interval
from duobench.results.statistics import (
    MOST_TABLES,
    PRIOR,
    any_time,
    barnard,
    cohen_h,
    episodes_needed,
    holm,
    mcnemar,
    mcnemar_power,
    newcombe_interval,
    paired_permutation,
    permutation,
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


# Heights of 15 pairs of maize plants in eighths of an inch, from Darwin.
MAIZE = (49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48)


@pytest.mark.parametrize(
    ("function", "args", "expected", "error"),
    [
        # Hyper-responsive airways of 21 children before and after a transplantation: 1 only before,
        # 7 only after. Fagerland, Lydersen and Laake, "The McNemar test for binary matched-pairs
        # data", BMC Med. Res. Methodol. 13:91 (2013), and their "Recommended tests and confidence
        # intervals for paired binomial proportions", Stat. Med. 33 (2014).
        (mcnemar, (1, 7), 0.0703, 5e-5),
        (tango_interval, (1, 7, 21), (-0.517, -0.026), 5e-4),
        # Of the 2^15 assignments of signs, 1726 have a sum as large. R. A. Fisher, "The Design of
        # Experiments" (1935), section 21.
        (paired_permutation, (MAIZE,), 1726 / 2**15, 5e-14),
        # Examples (a) to (g) of method 10 in Newcombe (1998), Stat. Med. 17, table II.
        (newcombe_interval, ((56, 48), (70, 80)), (0.0524, 0.3339), 5.1e-5),
        (newcombe_interval, ((9, 3), (10, 10)), (0.1705, 0.8090), 5.1e-5),
        (newcombe_interval, ((6, 2), (7, 7)), (0.0582, 0.8062), 5.1e-5),
        (newcombe_interval, ((5, 0), (56, 29)), (-0.0381, 0.1926), 5.1e-5),
        (newcombe_interval, ((0, 0), (10, 20)), (-0.1611, 0.2775), 5.1e-5),
        (newcombe_interval, ((0, 0), (10, 10)), (-0.2775, 0.2775), 5.1e-5),
        (newcombe_interval, ((10, 0), (10, 20)), (0.6791, 1.0000), 5.1e-5),
        # A vaccine: Mehta and Senchaudhuri (2003), one-sided .0341, as in SciPy's documentation.
        (barnard, ((7, 12), (15, 15)), 2 * 0.0341, 1e-4),
        # Manual of G*Power 3.1, chapter 5: odds ratio .25, discordant .4, one-sided level .05.
        (mcnemar_power, (50, 0.08, 0.32, 0.1), 0.839343, 5e-5),
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


@pytest.mark.parametrize(
    "differences",
    [(0, 0, 0), (1, 0), (2, -1, 0, 3, 1, 1, -1, 2), (5, 0, -3, 1, 1, 2, 4, -1, 1, 2)],
)
def test_paired_permutation_is_that_of_scipy(differences: tuple[int, ...]) -> None:
    result = permutation_test(
        (np.array(differences),), np.sum, permutation_type="samples", n_resamples=np.inf
    )
    assert paired_permutation(differences) == pytest.approx(result.pvalue)


def test_paired_permutation_stays_exact_where_nobody_could_enumerate() -> None:
    """With equal differences it is the test of the signs alone."""
    differences = [2] * 640 + [-2] * 560
    expected = binomtest(640, 1200).pvalue
    assert paired_permutation(differences) == pytest.approx(expected, rel=1e-9)


def test_permutation_counts_all_where_there_are_few() -> None:
    a, b = (3, 2, 3, 1), (0, 1, 1, 2)
    pool, observed = a + b, sum(a)
    sums = [sum(chosen) for chosen in itertools.combinations(pool, len(a))]
    far = abs(observed - sum(pool) / 2)
    expected = sum(abs(one - sum(pool) / 2) >= far for one in sums) / len(sums)
    assert permutation(a, b) == pytest.approx(expected)
    assert permutation((2, 2), (2, 2, 2)) == permutation((2,), (0, 0, 0)) == 1.0


def test_permutation_of_many_is_sampled_in_the_same_way_every_time() -> None:
    a, b = [3] * 30 + [0] * 20, [3] * 20 + [0] * 30
    assert permutation(a, b) == permutation(a, b) == pytest.approx(0.07, abs=0.02)


def extremeness(solved: tuple[int, int], episodes: tuple[int, int]) -> Fraction:
    rate = Fraction(sum(solved), sum(episodes))
    gap = Fraction(solved[0], episodes[0]) - Fraction(solved[1], episodes[1])
    return gap**2 / (rate * (1 - rate)) if 0 < rate < 1 else Fraction(0)


@pytest.mark.parametrize(
    ("successes", "episodes"),
    [
        ((5, 11), (20, 20)),
        ((0, 4), (10, 30)),
        ((6, 13), (20, 20)),
        ((6, 2), (15, 20)),
        ((1, 1), (3, 1)),
        ((6, 14), (10, 15)),
        ((13, 8), (30, 10)),
        ((9, 17), (12, 40)),
    ],
)
def test_barnard_counts_ties_exactly(successes: tuple[int, int], episodes: tuple[int, int]) -> None:
    observed = extremeness(successes, episodes)
    tables = itertools.product(*(range(n + 1) for n in episodes))
    extreme = [solved for solved in tables if extremeness(solved, episodes) >= observed]
    first, second = (np.array(k)[:, None] for k in zip(*extreme, strict=True))
    rates = np.linspace(0, 1, 4001)
    chances = binom.pmf(first, episodes[0], rates) * binom.pmf(second, episodes[1], rates)
    assert barnard(successes, episodes) == pytest.approx(chances.sum(0).max(), abs=1e-5)


def test_barnard_is_near_that_of_scipy() -> None:  # which loses some ties to rounding
    assert barnard_exact([[5, 11], [15, 9]]).pvalue == pytest.approx(
        barnard((5, 11), (20, 20)), 2e-3
    )


@pytest.mark.parametrize("solved", [0, 20])
def test_barnard_of_equal_extremes_is_one(solved: int) -> None:
    assert barnard((solved, solved), (20, 20)) == 1.0


def test_barnard_of_large_samples_goes_on_where_the_exact_one_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    exact = barnard((330, 360), (800, 800))
    monkeypatch.setattr(statistics, "MOST_TABLES", 1)
    assert barnard((330, 360), (800, 800)) == pytest.approx(exact, abs=0.01)
    assert MOST_TABLES > 1100**2


def test_holm_adjusts_the_smallest_most_and_keeps_the_order() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


def test_effect_size_grows_towards_the_ends() -> None:
    assert cohen_h(1.0, 0.0) == pytest.approx(math.pi)
    assert cohen_h(0.5, 0.4) == pytest.approx(0.2014, abs=1e-4)
    assert cohen_h(0.1, 0.0) > cohen_h(0.5, 0.4) == -cohen_h(0.4, 0.5)


# --- looking again and again ---------------------------------------------------------------------


def wealth(wins: Sequence[tuple[int, int]]) -> Fraction:
    """What a bet of 1 on the shares of the prior has become, as a plain sum."""
    x, y = map(int, PRIOR)

    def integral(a: int, b: int) -> Fraction:
        """Of share^a * (1 - share)^b over all shares."""
        terms = (Fraction((-1) ** k * math.comb(b, k), a + k + 1) for k in range(b + 1))
        return sum(terms, Fraction())

    first, second = (sum(each[side] for each in wins) for side in (0, 1))
    sides = integral(x + first - 1, y + second - 1) + integral(y + first - 1, x + second - 1)
    return sides * 2 ** (first + second) / (2 * integral(x - 1, y - 1))


@pytest.mark.parametrize(
    "wins",
    [
        [],
        [(0, 0)] * 3,
        [(1, 0)] * 10,
        [(1, 0)] * 12 + [(0, 1)] * 12,  # what it once was stays
        [(1, 0), (0, 0), (1, 0), (0, 1), (1, 0)] * 8,
        [(3, 1), (0, 2), (4, 0), (5, 1), (2, 2), (6, 0)],
    ],
)
def test_any_time_is_the_inverse_of_the_largest_wealth(wins: list[tuple[int, int]]) -> None:
    largest = max(wealth(wins[:look]) for look in range(len(wins) + 1))
    assert any_time(wins) == pytest.approx(float(1 / largest), rel=1e-9)
    assert any_time(wins) == any_time([(b, a) for a, b in wins])
    series = [any_time(wins[:look]) for look in range(len(wins) + 1)]
    assert series == sorted(series, reverse=True)


def test_a_bet_on_a_fair_coin_gains_nothing() -> None:
    for wins in itertools.product([(1, 0), (0, 1)], repeat=5):
        after = wealth([*wins, (1, 0)]), wealth([*wins, (0, 1)])
        assert sum(after) / 2 == wealth(wins)
    ends = list(itertools.product([(1, 0), (0, 1)], repeat=14))
    assert 0 < sum(any_time(wins) <= 0.05 for wins in ends) / len(ends) <= 0.05


@pytest.mark.parametrize("share", [0.5, 0.7, 1.0])
def test_policies_that_are_equal_on_average_over_tasks_gain_nothing(share: float) -> None:
    """Each is the better one in one of two tasks."""
    steps = {
        (2, 0): share * (1 - share),
        (1, 1): share * share + (1 - share) ** 2,
        (0, 2): share * (1 - share),
    }
    series = list(itertools.product(steps.items(), repeat=5))
    mean = sum(math.prod(p for _, p in each) * wealth([w for w, _ in each]) for each in series)
    assert mean <= 1 + 1e-12


def test_ten_looks_claim_too_often_by_mcnemar_and_not_by_any_time() -> None:
    once, ever = claims((0.3, 0.3), LOOKS, pairs=1_000)
    assert once > 0.09
    assert ever <= MOST_CLAIMS


def test_any_time_finds_a_large_difference_in_a_planned_number_of_episodes() -> None:
    _, found = claims((0.4, 0.2), (100,), pairs=1_000)
    assert found >= LEAST_POWER


# --- intervals and power keep what they promise --------------------------------------------------

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


def test_needed_episodes_give_the_power_and_fewer_do_not() -> None:
    number = episodes_needed(12, 6, 100)
    assert number is not None
    assert mcnemar_power(number, 0.12, 0.06) >= 0.8 > mcnemar_power(number * 9 // 10, 0.12, 0.06)
    stricter = episodes_needed(12, 6, 100, level=0.005)
    assert stricter is not None
    assert stricter > number


def test_power_is_the_share_of_all_outcomes_that_are_significant() -> None:
    outcomes = [(a, b) for a in range(31) for b in range(31 - a)]
    ways = [math.comb(30, a) * math.comb(30 - a, b) for a, b in outcomes]
    expected = sum(
        count * 0.3**a * 0.1**b * 0.6 ** (30 - a - b)
        for (a, b), count in zip(outcomes, ways, strict=True)
        if mcnemar(a, b) <= 0.05
    )
    assert mcnemar_power(30, 0.3, 0.1, level=0.05) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("counts", [(0, 0, 100), (7, 7, 100), (50_001, 50_000, 100_001)])
def test_no_number_of_episodes_is_made_up(counts: tuple[int, int, int]) -> None:
    assert episodes_needed(*counts) is None
