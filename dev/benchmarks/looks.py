"""What looking again and again costs, and what an any-time p-value finds.

`python -m dev.benchmarks.looks` simulates pairs of policies whose runs grow and are tested at every
look, by the exact McNemar test and by the any-time test, and pages of several equal policies.
"""

import argparse
from collections.abc import Sequence
from functools import cache
from itertools import combinations

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import track
from rich.table import Table

from duobench.results.statistics import (
    LEVEL,
    any_time,
    holm,
    mcnemar,
    paired_permutation,
)

Rates = tuple[float, float]

LOOKS = tuple(range(20, 201, 20))
EQUAL = (0.1, 0.3, 0.5, 0.8)
DIFFERENT = ((0.4, 0.2), (0.3, 0.15), (0.6, 0.5), (0.9, 0.7), (0.22, 0.12))
MOST_CLAIMS, LEAST_POWER = 0.055, 0.65
"""Bars: of equal policies after ten looks, and of 40 against 20 % with 100 episodes."""
POLICIES, TASKS, EPISODES = 5, 11, 20
STAGES = (0.3, 0.2, 0.1, 0.1, 0.3)
"""Chances of each last stage, of the policies of a page: most episodes stop early, or succeed."""

mcnemar_once = cache(mcnemar)


def wins(rates: Rates, episodes: int, rng: np.random.Generator) -> np.ndarray:
    """Whether only the first, and only the second policy solves each episode: (episodes, 2)."""
    a, b = (rng.random(episodes) < rate for rate in rates)
    return np.stack([a & ~b, b & ~a], axis=1).astype(int)


def claims(rates: Rates, looks: Sequence[int], pairs: int, seed: int = 0) -> Rates:
    """Shares of pairs that McNemar and the any-time test claim to differ at some look."""
    rng = np.random.default_rng(seed)
    found = np.zeros(2)
    for _ in range(pairs):
        only = wins(rates, max(looks), rng)
        p_values = [mcnemar_once(*map(int, only[:look].sum(axis=0))) for look in looks]
        # The any-time p-value never rises: at the last look it is the smallest one.
        found += min(p_values) <= LEVEL, any_time(only) <= LEVEL
    return float(found[0] / pairs), float(found[1] / pairs)


def is_claimed_on_page(rng: np.random.Generator) -> bool:
    """Whether a page of equal policies claims something: success or progress of any two of them."""
    stages = rng.choice(len(STAGES), (POLICIES, TASKS, EPISODES), p=STAGES)
    last = len(STAGES) - 1
    for a, b in combinations(stages, 2):
        only = np.stack([(a == last) & (b < last), (b == last) & (a < last)])
        families = (
            [mcnemar_once(*map(int, counts)) for counts in only.sum(axis=2).T],
            [mcnemar_once(*map(int, only.sum(axis=(1, 2))))],
            [paired_permutation(each) for each in (a - b).tolist()],
            [paired_permutation((a - b).ravel().tolist())],
        )
        if any(min(holm(family)) <= LEVEL for family in families):
            return True
    return False


def main() -> int:
    """Simulate, print one table, and tell by the exit status whether the bars were met."""
    parser = argparse.ArgumentParser(
        prog="python -m dev.benchmarks.looks", description=__doc__
    )
    parser.add_argument(
        "--equal", type=int, default=4_000, help="pairs of equal policies"
    )
    parser.add_argument(
        "--different", type=int, default=1_000, help="pairs of different ones"
    )
    parser.add_argument(
        "--pages", type=int, default=400, help="pages of equal policies"
    )
    arguments = parser.parse_args()
    table = Table(title="Pairs that are claimed to differ", box=SIMPLE_HEAD)
    for column in ("success rates", "looks at", "McNemar", "any-time", "bar"):
        table.add_column(column, justify="right", no_wrap=True)
    met = True
    equal: list[tuple[Rates, tuple[int, ...]]] = [
        ((rate, rate), looks) for rate in EQUAL for looks in ((100,), LOOKS)
    ]
    different: list[tuple[Rates, tuple[int, ...]]] = [
        (rates, (episodes,)) for rates in DIFFERENT for episodes in (100, 200)
    ]
    for rates, looks in track([*equal, *different], "Simulating"):
        pairs = arguments.equal if rates[0] == rates[1] else arguments.different
        once, any_look = claims(rates, looks, pairs)
        bar = ""
        if looks is LOOKS:
            bar, met = f"<= {MOST_CLAIMS}", met and any_look <= MOST_CLAIMS
        elif (rates, looks) == (DIFFERENT[0], (100,)):
            bar, met = f">= {LEAST_POWER}", met and any_look >= LEAST_POWER
        at = " .. ".join(map(str, sorted({min(looks), max(looks)})))
        names = " against ".join(f"{rate:.0%}" for rate in rates)
        table.add_row(names, at, f"{once:.1%}", f"{any_look:.1%}", bar)
    Console().print(table)
    rng = np.random.default_rng(0)
    pages = [is_claimed_on_page(rng) for _ in track(range(arguments.pages), "Pages")]
    print(
        f"Pages of {POLICIES} equal policies that claim something: {np.mean(pages):.0%}"
    )
    return 0 if met else 1


if __name__ == "__main__":
    raise SystemExit(main())
