"""What a few rollouts say about a policy: interval estimates of a success rate."""

from __future__ import annotations

import math
from statistics import NormalDist

CONFIDENCE = 0.95
"""Confidence of the intervals in tables and reports."""


def wilson_interval(
    successes: int, trials: int, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Wilson's score interval for the probability of a success.

    It stays inside 0..1 and keeps its coverage for few trials and for rates near 0 and 1, where
    the textbook interval (rate plus or minus two standard errors) collapses to a point.
    Source: E. B. Wilson, "Probable inference, the law of succession, and statistical inference",
    J. Am. Stat. Assoc. 22 (1927).

    Args:
        successes: How many trials succeeded.
        trials: How many there were; with none, nothing is known and the interval is 0..1.
        confidence: Probability with which the interval should cover the truth, between 0 and 1.

    Returns:
        Lower and upper end.

    Raises:
        ValueError: If the counts or the confidence are impossible.
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"Successes lie in 0..trials, got {successes} of {trials}.")
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"A confidence lies between 0 and 1, got {confidence}.")
    if trials == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf((1.0 + confidence) / 2.0)
    rate = successes / trials
    shrink = 1.0 + z * z / trials
    centre = (rate + z * z / (2 * trials)) / shrink
    half = z / shrink * math.sqrt(rate * (1.0 - rate) / trials + z * z / (4 * trials * trials))
    low = 0.0 if successes == 0 else max(0.0, centre - half)
    high = 1.0 if successes == trials else min(1.0, centre + half)
    return low, high
