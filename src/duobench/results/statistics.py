"""Statistics of two policies: tests, intervals of a difference, effect size, and power.

Two policies that played the same episodes are compared pair by pair, which tells more than two
samples of their own do. SciPy does the work and is loaded by the first function that needs it.
Where a function takes two successes or episodes, they are those of either policy, at least one
episode of each; `only_a` and `only_b` are episodes that only one of both solved, of those that both
played. P-values are two-sided; intervals are a lower and an upper end of the first policy's success
rate minus the second one's.
"""

import math
from collections.abc import Iterable, Sequence
from importlib import import_module
from statistics import NormalDist
from typing import Any

import numpy as np

from duobench.core.types import Array
from duobench.results.scores import CONFIDENCE, wilson_interval

LEVEL = 1.0 - CONFIDENCE
"""Probability of claiming a difference where there is none."""
POWER = 0.8
"""Probability of finding a difference, for which episodes are counted."""
MOST_EPISODES = 1_000_000
"""Above it, no number of episodes is given."""
MOST_TABLES = 4_000_000
"""Outcomes of two samples up to which Barnard's test is exact; its time grows with them."""
MOST_PLAYED = 10_000
"""Episodes of one sample up to which it is, for its memory grows with them."""
TIED = 1e-9
"""Relative difference up to which two outcomes are equally extreme, and differ by rounding."""
RATES = 256
"""Common rates at which an outcome's probability is looked at, for its largest; less than the width
of a binomial apart for as many episodes as `MOST_TABLES` allows."""
RESAMPLES = 9_999
"""Permutations of two samples, where there are more than can be enumerated."""
PRIOR = 14.0, 6.0
"""Beta prior of the any-time test: the better policy's share of the episodes that only one solves.

As if it had solved 14 of 20. Tuned once, at 40 against 20 % of 100 episodes: it finds that in
67 %, a symmetric prior in 63; a sharper one needs more than its 10 wins in a row (McNemar: 6).
"""


def _scipy(part: str) -> Any:
    """A part of SciPy, which is loaded at first use and has no types."""
    return import_module(f"scipy.{part}")


def mcnemar(only_a: int, only_b: int) -> float:
    """P-value of the exact McNemar test: does one of two policies solve more of the same episodes?

    Given how many episodes only one of them solved, which one it was is a toss of a fair coin, if
    they are equally good. It is 1 if no episode tells them apart.
    Source: Q. McNemar, "Note on the sampling error of the difference between correlated
    proportions or percentages", Psychometrika 12 (1947).
    """
    discordant = only_a + only_b
    return float(_scipy("stats").binomtest(only_a, discordant).pvalue) if discordant else 1.0


def any_time(wins: Iterable[tuple[int, int]]) -> float:
    """P-value that holds at every look: does one of two policies solve more of the same episodes?

    It is the inverse of the largest wealth so far of a bet on which policy solves the next episode
    that only one solves, a mixture over `PRIOR` and its mirror image. If the policies are equally
    good, that wealth ever reaches 20 in at most 5 % (Ville's inequality). Tasks at one index are
    one step, looked at after all of them: so equal means equal on average over the tasks, as for
    McNemar, and not in each.
    Source: A. Ramdas, P. Grünwald, V. Vovk and G. Shafer, "Game-theoretic statistics and safe
    anytime-valid inference", Stat. Sci. 38 (2023); J. Ville, "Étude critique de la notion de
    collectif" (1939).

    Args:
        wins: Episodes that only the first, and only the second policy solved, index by index.
    """
    betaln = _scipy("special").betaln
    first, second = np.cumsum([(0, 0), *wins], axis=0).T
    chances = np.logaddexp(*(betaln(x + first, y + second) for x, y in (PRIOR, PRIOR[::-1])))
    wealth = chances - chances[0] + (first + second) * math.log(2)
    return math.exp(-float(np.max(wealth)))


def barnard(successes: tuple[int, int], episodes: tuple[int, int]) -> float:
    """P-value of Barnard's exact test: do policies solve different shares of different episodes?

    It orders outcomes by the difference over its standard error, pooled, and takes the largest
    p-value over the unknown common rate. With more than `MOST_TABLES` outcomes or `MOST_PLAYED`
    episodes, that statistic is taken to be normal.
    Source: G. A. Barnard, "Significance tests for 2 x 2 tables", Biometrika 34 (1947); with this
    order, S. Suissa and J. J. Shuster, J. R. Stat. Soc. A 148 (1985).
    """
    solved, played = sum(successes), sum(episodes)
    if solved in {0, played}:
        return 1.0
    if math.prod(episodes) <= MOST_TABLES and max(episodes) <= MOST_PLAYED:
        return _barnard(successes, episodes)
    rates = [k / n for k, n in zip(successes, episodes, strict=True)]
    variance = solved / played * (1 - solved / played) * sum(1 / n for n in episodes)
    return 2 * NormalDist().cdf(-abs(rates[0] - rates[1]) / math.sqrt(variance))


def _barnard(successes: tuple[int, int], episodes: tuple[int, int]) -> float:
    # SciPy's `barnard_exact` loses outcomes that are tied with the observed one to rounding.
    counts = [np.arange(n + 1) for n in episodes]
    solved = np.add.outer(*counts)
    gap = np.subtract.outer(*(k / n for k, n in zip(counts, episodes, strict=True))) ** 2
    order = gap / np.maximum(solved * (sum(episodes) - solved), 1)
    extreme = (order >= order[successes] * (1 - TIED)).astype(float)

    def chances(angles: Array) -> Array:
        rates = np.sin(angles[:, None]) ** 2  # a binomial is equally wide in all of these angles
        first, second = (
            _scipy("stats").binom.pmf(k, n, rates) for k, n in zip(counts, episodes, strict=True)
        )
        return np.einsum("ri,ri->r", first @ extreme, second)

    largest, middle, width = 0.0, math.pi / 4, math.pi / 4
    for _ in range(3):
        angles = np.linspace(middle - width, middle + width, RATES)
        found = chances(angles)
        largest = max(largest, float(np.max(found)))
        middle, width = float(angles[np.argmax(found)]), 2 * width / (RATES - 1)
    return min(1.0, largest)


def paired_permutation(differences: Sequence[int]) -> float:
    """P-value of the exact paired permutation test: is the mean of differences another one than 0?

    If it makes no difference which policy is which, every difference may as well have the other
    sign. Whole numbers, as stages are, have so few different sums that all 2^n assignments of
    signs are counted.
    Source: R. A. Fisher, "The Design of Experiments" (1935), section 21.
    """
    sizes = [abs(difference) for difference in differences if difference]
    chances = np.ones(1)  # of each sum of those sizes that have a positive sign
    for size in sizes:
        chances = (np.pad(chances, (0, size)) + np.pad(chances, (size, 0))) / 2
    total = sum(sizes)
    sums = 2 * np.arange(total + 1) - total
    return min(1.0, math.fsum(chances[abs(sums) >= abs(sum(differences))]))


def permutation(a: Sequence[int], b: Sequence[int]) -> float:
    """P-value of the permutation test: do the means of two samples differ?

    Exact where there are few enough permutations; otherwise `RESAMPLES` of them are sampled, the
    same in every call. It is 1 if all values are the same, or one sample is a single value.
    """
    if len({*a, *b}) == 1 or min(len(a), len(b)) == 1:
        return 1.0

    def difference(x: np.ndarray, y: np.ndarray, axis: int = -1) -> np.ndarray:
        return np.mean(x, axis=axis) - np.mean(y, axis=axis)

    result = _scipy("stats").permutation_test(
        (np.array(a, float), np.array(b, float)),
        difference,
        vectorized=True,
        n_resamples=RESAMPLES,
        batch=1_000,
        rng=np.random.default_rng(0),
    )
    return float(result.pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjust the p-values of several tests, so that all claims together have one level.

    A test rejects if its adjusted p-value, in the same place, is at most the level. Any-time
    p-values are valid at every look afterwards too, for Holm asks for no independence: R. Johari,
    P. Koomen, L. Pekelis and D. Walsh, "Always valid inference", Oper. Res. 70 (2022).
    Source: S. Holm, "A simple sequentially rejective multiple test procedure", Scand. J. Stat. 6
    (1979).
    """
    order = sorted(range(len(p_values)), key=p_values.__getitem__)
    adjusted = [1.0] * len(p_values)
    largest = 0.0
    for rank, index in enumerate(order):
        largest = max(largest, (len(p_values) - rank) * p_values[index])
        adjusted[index] = min(1.0, largest)
    return adjusted


def tango_interval(
    only_a: int, only_b: int, episodes: int, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Tango's score interval for the difference of success rates on the same episodes.

    It holds the differences that a score test would not reject, stays inside -1..1, and does not
    collapse where few episodes tell the policies apart.
    Source: T. Tango, "Equivalence test and confidence interval for the difference in proportions
    for the paired-sample design", Stat. Med. 17 (1998).
    """
    z = NormalDist().inv_cdf((1.0 + confidence) / 2.0)
    estimate = (only_a - only_b) / episodes

    def excess(difference: float, sign: float) -> float:
        """What the score at a difference exceeds its limit by."""
        linear = (2 * episodes - only_a + only_b) * difference - only_a - only_b
        constant = -only_b * difference * (1 - difference)
        root = math.sqrt(max(0.0, linear * linear - 8 * episodes * constant))
        only_b_rate = (root - linear) / (4 * episodes)  # most likely one at this difference
        variance = episodes * (2 * only_b_rate + difference * (1 - difference))
        score = only_a - only_b - episodes * difference
        return score - sign * z * math.sqrt(max(0.0, variance))

    def end(low: float, high: float, sign: float) -> float:
        solve = _scipy("optimize").root_scalar
        return float(solve(excess, (sign,), bracket=(low, high), method="brentq").root)

    beside = 1e-12  # at the estimate itself, both sides are 0 where no episode tells them apart
    low = -1.0 if only_b == episodes else end(-1.0, estimate - beside, 1.0)
    high = 1.0 if only_a == episodes else end(estimate + beside, 1.0, -1.0)
    return low, high


def newcombe_interval(
    successes: tuple[int, int], episodes: tuple[int, int], confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Newcombe's hybrid score interval for the difference of success rates on other episodes.

    Source: R. G. Newcombe, "Interval estimation for the difference between independent
    proportions: comparison of eleven methods", Stat. Med. 17 (1998), method 10.
    """
    rate_a, rate_b = (k / n for k, n in zip(successes, episodes, strict=True))
    low_a, high_a = wilson_interval(successes[0], episodes[0], confidence)
    low_b, high_b = wilson_interval(successes[1], episodes[1], confidence)
    difference = rate_a - rate_b
    return (
        max(-1.0, difference - math.hypot(rate_a - low_a, high_b - rate_b)),
        min(1.0, difference + math.hypot(high_a - rate_a, rate_b - low_b)),
    )


def cohen_h(rate_a: float, rate_b: float) -> float:
    """Effect size of a difference of two rates; about .2 is small, .5 medium, .8 large.

    Source: J. Cohen, "Statistical Power Analysis for the Behavioral Sciences" (1988), chapter 6.
    """
    return 2 * (math.asin(math.sqrt(rate_a)) - math.asin(math.sqrt(rate_b)))


def mcnemar_power(episodes: int, chance_a: float, chance_b: float, level: float = LEVEL) -> float:
    """Probability that the exact McNemar test of a level finds a difference.

    The chances are probabilities that only one of both policies solves an episode; one is positive.
    """
    binom = _scipy("stats").binom
    discordant = chance_a + chance_b
    spread = 8 * math.sqrt(episodes * discordant * (1 - discordant)) + 10
    first = max(0, math.floor(episodes * discordant - spread))
    last = min(episodes, math.ceil(episodes * discordant + spread))
    counts = np.arange(first, last + 1)
    # The largest number of wins of the less successful policy at which the test still rejects.
    below = binom.ppf(level / 2, counts, 0.5)
    most = below - (binom.cdf(below, counts, 0.5) > level / 2)
    share = chance_a / discordant
    rejects = binom.cdf(most, counts, share) + binom.cdf(most, counts, 1 - share)
    return float(np.dot(binom.pmf(counts, episodes, discordant), rejects))


def episodes_needed(
    only_a: int, only_b: int, episodes: int, level: float = LEVEL, power: float = POWER
) -> int | None:
    """How many episodes the exact McNemar test would need to find the difference that was seen.

    It takes what was seen for the truth, so the number is a rough one. The power rises in small
    teeth, of which one is found. It is None if no difference was seen, or above `MOST_EPISODES`.
    """
    if only_a == only_b:
        return None
    chances = only_a / episodes, only_b / episodes
    too_few, enough = 0, 1
    while mcnemar_power(enough, *chances, level) < power:
        too_few, enough = enough, 2 * enough
        if too_few > MOST_EPISODES:
            return None
    while enough - too_few > 1:
        middle = (too_few + enough) // 2
        is_enough = mcnemar_power(middle, *chances, level) >= power
        too_few, enough = (too_few, middle) if is_enough else (middle, enough)
    return enough
