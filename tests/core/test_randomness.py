"""What is drawn: within its bounds, evenly, and decided by its seed alone."""

import math
import os

import numpy as np
import pytest
from scipy import stats

from duobench.core.errors import UnknownNameError
from duobench.core.randomness import (
    ANY_YAW,
    EVAL,
    SPLITS,
    SUITE_VERSION,
    TRAIN,
    Choice,
    Uniform,
    around,
    episode_seed,
    generator,
    layout_key,
    policy_seed,
)
from duobench.tasks import catalog
from tests.children import printed
from tests.quick_first import quick_first

DRAW = "from tests.core.test_randomness import numbers; print(numbers())"


def numbers() -> tuple[int, int, int]:
    """What a generator draws first, and both seeds of an episode."""
    return first_draw("bin_sort", 3), episode_seed("bin_sort", 3), policy_seed("bin_sort", 3)


def first_draw(task: str, seed: int) -> int:
    return int(generator(task, seed).integers(2**62))


def test_a_generator_is_a_function_of_task_and_seed_of_the_eval_split() -> None:
    assert first_draw("bin_sort", 3) == generator("bin_sort", 3, EVAL).integers(2**62)
    assert first_draw("bin_sort", 3) == first_draw("bin_sort", 3)
    assert first_draw("bin_sort", np.int64(3)) == first_draw("bin_sort", 3)  # type: ignore[arg-type]
    draws = {first_draw(task, seed) for task in ("bin_sort", "carry_pot") for seed in range(50)}
    assert len(draws) == 100


@pytest.mark.parametrize("seed", quick_first(["0", "1"]))
def test_other_processes_draw_the_same(seed: str) -> None:
    drawn = printed(DRAW, env={**os.environ, "PYTHONHASHSEED": seed})
    assert drawn == f"{numbers()}\n"


def test_the_suite_version_decides_too(monkeypatch: pytest.MonkeyPatch) -> None:
    before = numbers()
    monkeypatch.setattr("duobench.core.randomness.SUITE_VERSION", SUITE_VERSION + "x")
    assert set(numbers()).isdisjoint(before)


def test_episode_seeds_are_distinct_32_bit_numbers() -> None:
    seeds = [episode_seed("bin_sort", episode) for episode in range(1000)]
    assert len(set(seeds)) == 1000
    assert seeds[3] == episode_seed("bin_sort", 3, EVAL)
    with pytest.raises(ValueError, match="from 0, got -1"):
        episode_seed("bin_sort", -1)
    assert all(0 <= seed < 2**32 for seed in seeds)
    assert stats.kstest(np.array(seeds) / 2**32, "uniform").pvalue > 0.01
    assert set(seeds).isdisjoint(episode_seed("carry_pot", episode) for episode in range(1000))


def test_a_policy_seed_is_the_same_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("duobench.core.randomness.SUITE_VERSION", "4")
    assert policy_seed("bin_sort", 0) == policy_seed("bin_sort", np.int64(0), EVAL) == 2647481196  # type: ignore[arg-type]
    assert policy_seed("bin_sort", 0, TRAIN) == 1644153258


def test_policy_seeds_are_32_bit_numbers_unrelated_to_other_seeds() -> None:
    names, count = ("bin_sort", "carry_pot"), 1000
    seeds = {policy_seed(name, n, s) for name in names for n in range(count) for s in SPLITS}
    assert len(seeds) == len(names) * count * len(SPLITS)
    assert all(0 <= seed < 2**32 for seed in seeds)
    assert stats.kstest(np.array(sorted(seeds)) / 2**32, "uniform").pvalue > 0.01
    assert seeds.isdisjoint(
        episode_seed(name, n, s) for name in names for n in range(count) for s in (EVAL, TRAIN)
    )


@pytest.mark.parametrize("name", catalog.names())
def test_the_layout_of_a_policy_seed_is_another_one(name: str) -> None:
    """In whichever split it is made: with plain seeds and with those of the suite."""
    task = catalog.get(name)
    for split in SPLITS:
        for seed, hashed in seeds_of(name, split):
            shown = next(task.layouts(seed, split)).to_json()["poses"]
            made = [next(task.layouts(hashed, each)).to_json()["poses"] for each in SPLITS]
            assert shown not in made


def seeds_of(name: str, split: str) -> list[tuple[int, int]]:
    """Seeds of resets, plain ones and those of episodes, with those of the policy."""
    seeds = [*range(20), *(episode_seed(name, n, split) for n in range(20))]
    return [(seed, policy_seed(name, seed, split)) for seed in seeds]


FIRST = range(100_000)


@pytest.mark.long
@pytest.mark.parametrize("name", catalog.names())
def test_layouts_of_two_splits_never_meet(name: str) -> None:
    """No two keys of generators are equal, so no generator begins like another."""
    keys = {layout_key(name, seed, split) for split in SPLITS for seed in FIRST}
    assert len(keys) == len(SPLITS) * len(FIRST)


@pytest.mark.slow
def test_generators_of_both_splits_begin_with_other_numbers() -> None:
    draws = {generator("bin_sort", seed, s).random() for s in (EVAL, TRAIN) for seed in FIRST}
    assert len(draws) == 2 * len(FIRST)


def test_episode_seeds_of_both_splits_differ() -> None:
    seeds = [{episode_seed("bin_sort", n, split) for n in range(1000)} for split in (EVAL, TRAIN)]
    assert seeds[0].isdisjoint(seeds[1])


@pytest.mark.parametrize("split", ["test", "", None, 0])
def test_an_unknown_split_is_refused(split: str) -> None:
    for call in (generator, layout_key, episode_seed, policy_seed):
        with pytest.raises(UnknownNameError, match=r"split.*Known: eval, train"):
            call("bin_sort", 0, split)


def test_neighbouring_seeds_are_unrelated() -> None:
    draws = [generator("bin_sort", seed).uniform() for seed in range(500)]
    assert stats.kstest(draws, "uniform").pvalue > 0.01
    assert abs(stats.pearsonr(draws[:-1], draws[1:]).statistic) < 0.15


@pytest.mark.parametrize("box", [Uniform(-1.0, 2.0), around(0.5, 0.1), ANY_YAW])
def test_uniform_numbers_fill_their_range(box: Uniform) -> None:
    rng = np.random.default_rng(0)
    draws = [box.sample(rng) for _ in range(500)]
    assert all(box.low <= draw < box.high for draw in draws)
    assert stats.kstest(draws, "uniform", args=(box.low, box.high - box.low)).pvalue > 0.01
    assert (around(0.5, 0.1).low, around(0.5, 0.1).high) == (0.4, 0.6)
    assert (ANY_YAW.low, ANY_YAW.high) == (-math.pi, math.pi)
    assert Uniform(0.3, 0.3).sample(rng) == 0.3


@pytest.mark.parametrize(("low", "high"), [(1.0, 0.0), (math.nan, 1.0)])
def test_an_empty_range_is_refused(low: float, high: float) -> None:
    with pytest.raises(ValueError, match="low <= high"):
        Uniform(low, high)


def test_choices_are_equally_likely() -> None:
    rng = np.random.default_rng(0)
    options = ("left", "right", "both")
    counts = dict.fromkeys(options, 0)
    for _ in range(600):
        counts[Choice(options).sample(rng)] += 1
    assert stats.chisquare(list(counts.values())).pvalue > 0.01
