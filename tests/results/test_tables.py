from pathlib import Path
from typing import Any

import pytest

from duobench.results import tables
from duobench.results.comparison import compare
from duobench.results.pairs import Pair
from tests.results.outcomes import play

WON = {"sort": [3] * 12, "turn": [1] * 12, "lift": [2] * 6 + [0] * 6}
LOST = {"sort": [0] * 12, "turn": [1] * 11 + [0], "lift": [2] * 6 + [0] * 6}
TURN = {"turn": [1] * 12}, {"turn": [1] * 11 + [0]}


def pair_of(tmp_path: Path, a: dict[str, list[int]], b: dict[str, list[int]], **run: Any) -> Pair:
    sources = play(tmp_path / "a", a, "new"), play(tmp_path / "b", b, "old", **run)
    (pair,) = compare(sources).pairs
    return pair


@pytest.mark.parametrize(
    ("a", "b", "run", "cells"),
    [
        (WON, LOST, {}, ["same episodes", "1 / 0 of 3"]),
        (LOST, WON, {}, ["same episodes", "0 / 1 of 3"]),
        (WON, LOST, {"object_state": True}, ["same episodes", "1 / 0 of 3"]),
        (WON, WON, {}, ["same episodes", "0 / 0 of 3"]),
        (WON, LOST, {"first_episode": 12}, ["different episodes", "–"]),
        ({"sort": [3] * 12}, {"sort": [0] * 12}, {}, ["same episodes", "1 / 0 of 1"]),
    ],
)
def test_a_pair_is_a_row_that_counts_the_tasks_won(
    tmp_path: Path,
    a: dict[str, list[int]],
    b: dict[str, list[int]],
    run: dict[str, Any],
    cells: list[str],
) -> None:
    row = tables.pair_cells(pair_of(tmp_path, a, b, **run))
    assert len(row) == len(tables.PAIR_HEADS)
    assert row[:4] == ["new", "old", *cells]


def test_a_test_is_a_row_of_numbers(tmp_path: Path) -> None:
    pair = pair_of(tmp_path, *TURN)
    (test,) = pair.tests
    cells = dict(zip(tables.TEST_HEADS, tables.test_cells(test), strict=True))
    assert cells["Successes"] == "12 / 11"
    assert cells["Only one solved"] == "1 / 0"
    assert cells["p, Holm"] == "1.000"
    assert cells["Difference / points"] == "+8.3"
    further = int(cells["Episodes that would tell"])
    assert further == test.more_episodes
    assert pair.whole is test
    assert 50 < further < 150


def test_a_row_of_different_episodes_has_an_interval_and_no_test(tmp_path: Path) -> None:
    (test,) = pair_of(tmp_path, *TURN, first_episode=12).tests
    cells = dict(zip(tables.TEST_HEADS, tables.test_cells(test), strict=True))
    assert [cells[head] for head in ("Only one solved", "p, Holm", "Episodes that would tell")] == (
        ["–"] * 3
    )
    assert " to " in cells["95 % interval / points"]


def test_numbers_as_text() -> None:
    assert [tables.count_text(n) for n in (None, 7, 18_001)] == ["–", "7", "18,001"]
    assert [tables.p_text(p) for p in (0.0004, 0.0123, 1.0)] == ["< 0.001", "0.012", "1.000"]
    signed = [tables.signed(x, 1) for x in (0.04, -0.04, 1.25, -3.0)]
    assert signed == ["0.0", "0.0", "+1.2", f"{tables.MINUS}3.0"]
    assert tables.listed(["a"]) == "a"
    assert tables.listed(["a", "b", "c"]) == "a, b and c"
