from pathlib import Path

import numpy as np
import pytest

from dev.benchmarks.measure import Measurement, Work, seconds
from dev.benchmarks.variety import Paths, compare, figure_of, resampled, table_of
from tests.children import ran

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ("bars", "met", "text"),
    [
        ({}, True, ""),
        ({"at_most": 2.0}, True, "<= 2"),
        ({"at_most": 1.9}, False, "<= 1.9"),
        ({"at_least": 2.0}, True, ">= 2"),
        ({"at_least": 2.1}, False, ">= 2.1"),
    ],
)
def test_a_bar_is_met_or_missed(bars: dict[str, float], *, met: bool, text: str) -> None:
    measurement = Measurement(what="speed", value=2.0, **bars)
    assert measurement.met is met
    assert measurement.bar == text


def test_works_take_turns_after_their_preparation() -> None:
    order: list[str] = []

    def work(name: str) -> Work:
        return Work(
            prepare=lambda: order.append(f"prepare {name}"),
            pieces=[lambda: order.append(f"{name} 0"), lambda: order.append(f"{name} 1")],
        )

    times = seconds(work("a"), work("b"), repeats=2)
    once = ["prepare a", "prepare b", "a 0", "b 0", "a 1", "b 1"]
    assert order == once * 2
    assert all(time > 0 for time in times)


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (["resets", "--tasks", "transfer_cube"], None, "transfer_cube: reset"),
        (["colour"], 2, "known: imports"),
    ],
)
def test_the_command_prints_what_it_measured_or_may(
    arguments: list[str], code: int | None, told: str
) -> None:
    done = ran("-m", "dev.benchmarks", *arguments, cwd=ROOT)
    assert told in (done.stdout if code is None else done.stderr), done.stderr
    assert code in (None, done.returncode)


# --- spread of paths -----------------------------------------------------------------------------


def path(times: np.ndarray, *, aside: float = 0.0) -> np.ndarray:
    """Both tools go one metre along x, the left one at some distance (m) to one side of it."""
    points = np.zeros((len(times), 2, 3))
    points[:, :, 0] = times[:, None]
    points[:, 0, 1] = aside
    return points


def test_paths_are_compared_by_length_and_not_by_time() -> None:
    steady, hurried = np.linspace(0.0, 1.0, 50), np.linspace(0.0, 1.0, 80) ** 3
    paths = Paths(positions=(path(steady), path(hurried)))
    assert paths.spread == pytest.approx([0.0, 0.0], abs=1e-12)
    assert paths.seconds == pytest.approx([50 / 30, 80 / 30])
    along = resampled(path(hurried))[:, 0, 0]
    assert np.diff(along) == pytest.approx(1.0 / (len(along) - 1))


def test_the_spread_is_the_distance_from_the_mean_path() -> None:
    line = np.linspace(0.0, 1.0, 50)
    paths = Paths(positions=(path(line, aside=0.02), path(line, aside=-0.02)))
    assert paths.spread == pytest.approx([0.02, 0.0])


@pytest.mark.slow
def test_variety_spreads_paths_where_the_layout_explains_nothing() -> None:
    comparison = compare("bin_sort", "human", episodes=2)
    assert (comparison.varied.spread > 0.001).all()
    again = compare("bin_sort", "none", episodes=2)
    assert again.varied.spread.max() == 0.0
    assert (again.plain.spread == comparison.plain.spread).all()
    assert len(figure_of([comparison], "human").axes) == 4
    assert table_of([comparison], "human").row_count == 1
