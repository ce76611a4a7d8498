import re
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest

from duobench.core.errors import EvaluationError, UnknownNameError
from duobench.results.entrants import (
    AUTHORS,
    PAPER,
    Cell,
    Group,
    check_policy,
    published,
    read_entrants,
    split_name,
    value_of,
)
from duobench.results.tables import cell_text
from duobench.tasks import catalog
from duobench.tasks.shifts.shift import Shift
from tests.results.outcomes import play

SOME = {"sort": [3, 1, 0]}


def test_groups_stand_apart_and_letters_and_names_follow_them(tmp_path: Path) -> None:
    told, sees, expert, again = (
        play(tmp_path / name, SOME, name, object_state=name == "told")
        for name in ("told", "sees", "expert", "sees/again")
    )
    entrants = read_entrants(["paper:ACT", told, sees, expert])
    assert [(one.key, one.name, one.group) for one in entrants] == [
        ("A", "sees", Group.UNPRIVILEGED),
        ("B", "told", Group.PRIVILEGED),
        ("C", "expert", Group.PRIVILEGED),
        ("D", "ACT [paper]", Group.ELSEWHERE),
    ]
    assert [one.name for one in read_entrants([sees, sees])] == ["sees (A)", "sees (B)"]
    assert [one.name for one in read_entrants([f"small={sees}", again])] == ["small", "sees/again"]


def test_an_equals_sign_in_a_path_is_no_name(tmp_path: Path) -> None:
    folder = tmp_path / "lr=1"
    folder.mkdir()
    assert split_name(str(folder)) == ("", folder, None)
    assert split_name("a=b@look-2") == ("a", Path("b"), Shift(axis="look", level=2))
    assert split_name("a=b") == ("a", Path("b"), None)


@pytest.mark.parametrize(
    ("sources", "message"),
    [
        (["{run}"], "2 to 26 runs, got 1"),
        (["paper:ACT", "authors:ACT"], "needs a run"),
        (["{run}", "{empty}"], "no finished episode"),
    ],
)
def test_what_is_no_comparison_is_rejected(
    sources: list[str], message: str, tmp_path: Path
) -> None:
    run, empty = play(tmp_path / "run", SOME), play(tmp_path / "empty", {"sort": []})
    with pytest.raises(EvaluationError, match=message):
        read_entrants([source.format(run=run, empty=empty) for source in sources])


TABLE = published(PAPER)
CARDS = published(AUTHORS)


def test_every_task_and_category_of_the_benchmark_is_there() -> None:
    tasks = [catalog.get(name) for name in catalog.names()]
    assert set(TABLE.tasks) == {task.id for task in tasks}
    for category in {str(task.category) for task in tasks}:
        members = {task.id for task in tasks if str(task.category) == category}
        assert TABLE.means[category].tasks == members
    assert TABLE.means["overall"].tasks == set(TABLE.tasks)


@pytest.mark.parametrize("policy", TABLE.policies)
def test_means_are_those_of_the_tasks_but_for_rounding(policy: str) -> None:
    for mean in TABLE.means.values():
        pairs: list[Any] = [TABLE.tasks[task][policy] for task in mean.tasks]
        rates, progress = zip(*pairs, strict=True)
        rate, average = mean.values[policy]
        assert rate == pytest.approx(fmean(rates), abs=0.51)
        assert average == pytest.approx(fmean(progress), abs=0.0101)


@pytest.mark.parametrize(
    ("tasks", "value"),
    [
        (["carry_pot"], (44, 0.63)),
        (["hinge_chest", "spring_door", "pour_marbles"], (12, 0.25)),
        (["hinge_chest", "spring_door"], None),
        (["mine"], None),
    ],
)
def test_a_mean_over_other_tasks_is_not_made_up(
    tasks: list[str], value: tuple[float, float] | None
) -> None:
    assert value_of(TABLE, "ACT", tasks) == value


READ_ON_CARDS = {
    "xvla": """
        ball_maze 2.0 (0.9-4.3), bin_sort 1.0 (0.3-2.9), block_balance 0.0 (0.0-1.3),
        carry_pot 12.3 (9.1-16.5), hinge_chest 12.0 (8.8-16.2), join_blocks 0.0 (0.0-1.3),
        pour_marbles 0.0 (0.0-1.3), spring_door 13.7 (10.2-18.0), transfer_cube 9.3 (6.5-13.2),
        transfer_gate 26.3 (21.7-31.6), transfer_reorient 0.0 (0.0-1.3)""",
    "pi05": "ball_maze 5.0 (3.1-8.1), bin_sort 1.7 (0.7-3.8)",
    "ACT": "carry_pot 54.0 (48.3-59.6)",
}
"""Success rates (%) and 95 % Wilson intervals, as they stand there."""


@pytest.mark.parametrize("policy", CARDS.policies)
def test_counts_give_the_rates_and_intervals_of_the_authors_cards(policy: str) -> None:
    cells = {}
    for task in CARDS.tasks:
        if cell := Cell.quoted(f"authors:{policy}", [task]):
            assert (cell.episodes, cell.progress, cell.interval is None) == (300, None, False)
            low, high = (f"{100 * end:.1f}" for end in cell.interval or ())
            cells[task] = f"{100 * cell.rate:.1f} ({low}-{high})"
    assert cells == dict(re.findall(r"(\w+) ([\d.]+ \([\d.]+-[\d.]+\))", READ_ON_CARDS[policy]))


def test_authors_successes_add_up_only_where_each_task_is_there() -> None:
    tasks = catalog.names()
    every = Cell.quoted("authors:xvla", tasks)
    assert every is not None
    assert (every.episodes, every.successes, cell_text(every)) == (3300, 230, "7.0 (–)")
    assert Cell.quoted("authors:pi05", tasks) is None
    some = Cell.quoted("authors:pi05", ["ball_maze", "bin_sort"])
    assert some is not None
    assert (some.episodes, some.successes) == (600, 20)
    assert Cell.quoted("authors:xvla", ["mine"]) is None


def test_unknown_policy_says_which_there_are() -> None:
    assert check_policy("paper:ACT") == (TABLE, "ACT")
    assert check_policy("authors:ACT") == (CARDS, "ACT")
    with pytest.raises(UnknownNameError, match="paper:pi05, paper:xvla"):
        check_policy("paper:act2")
    with pytest.raises(UnknownNameError, match="Did you mean 'authors:xvla'"):
        check_policy("authors:xlva")
