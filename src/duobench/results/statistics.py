"""Statistics of two policies: a test, intervals of a difference, and episodes that would tell.

Two policies that played the same episodes are compared pair by pair, which tells more than two
samples of their own do. SciPy is loaded by the first function that needs it. Where a function takes
two successes or episodes, they are those of either policy, at least one episode of each; `only_a`
and `only_b` are episodes that only one of both solved, of those that both played. P-values are
two-sided; intervals are a lower and an upper end of the first policy's success rate minus the
second one's.
"""

import math
from collections.abc import Sequence
from importlib import import_module
from statistics import NormalDist
from typing import Any

from duobench.results.scores import CONFIDENCE, wilson_interval

LEVEL = 1.0 - CONFIDENCE
"""Significance level: probability of claiming a difference between equal policies."""
POWER = 0.8
"""Probability of finding a difference, for which episodes are counted."""


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
    return (
        float(_scipy("stats").binomtest(only_a, discordant).pvalue)
        if discordant
        else 1.0
    )


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjust the p-values of several tests, so that all claims together have one level.

    A test rejects if its adjusted p-value, in the same place, is at most the level.
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
        """Excess of the score at a difference over its limit."""
        linear = (2 * episodes - only_a + only_b) * difference - only_a - only_b
        constant = -only_b * difference * (1 - difference)
        root = math.sqrt(max(0.0, linear * linear - 8 * episodes * constant))
        only_b_rate = (root - linear) / (
            4 * episodes
        )  # most likely one at this difference
        variance = episodes * (2 * only_b_rate + difference * (1 - difference))
        score = only_a - only_b - episodes * difference
        return score - sign * z * math.sqrt(max(0.0, variance))

    def end(
        low: float,
        high: float,
        sign: float,
    ) -> float:
        solve = _scipy("optimize").root_scalar
        return float(
            solve(
                excess,
                (sign,),
                bracket=(low, high),
                method="brentq",
            ).root
        )

    beside = 1e-12  # at the estimate itself, both sides are 0 where no episode tells them apart
    low = -1.0 if only_b == episodes else end(-1.0, estimate - beside, 1.0)
    high = 1.0 if only_a == episodes else end(estimate + beside, 1.0, -1.0)
    return low, high


def newcombe_interval(
    successes: tuple[int, int],
    episodes: tuple[int, int],
    confidence: float = CONFIDENCE,
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


def episodes_that_would_tell(
    only_a: int, only_b: int, episodes: int, level: float = LEVEL, power: float = POWER
) -> int | None:
    """Count the further episodes after which McNemar's test would find the difference seen.

    It is Connor's sample size for a test of that level and power, less the episodes played, and at
    least 1. The observed difference is taken for the true one, so the number is a rough one. None
    if no difference was observed.
    Source: R. J. Connor, "Sample size for testing differences in proportions for the paired-sample
    design", Biometrics 43 (1987).
    """
    if only_a == only_b:
        return None
    differing = (only_a + only_b) / episodes
    difference = (only_a - only_b) / episodes
    normal = NormalDist()
    root = normal.inv_cdf(1.0 - level / 2.0) * math.sqrt(differing)
    root += normal.inv_cdf(power) * math.sqrt(differing - difference * difference)
    needed = math.ceil((root / difference) ** 2)
    return max(1, needed - episodes)
