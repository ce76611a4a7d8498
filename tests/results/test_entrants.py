from pathlib import Path
from statistics import fmean

import pytest

from duobench.errors import EvaluationError, UnknownNameError
from duobench.results.entrants import (
    Group,
    check_policy,
    paper_results,
    read_entrants,
    split_name,
    value_of,
)
from duobench.shifts.shift import Shift
from duobench.tasks import catalog
from tests.docs.markdown import ROOT, tables
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
        (["paper:ACT", "paper:xvla"], "needs a run"),
        (["{run}", "{empty}"], "no finished episode"),
    ],
)
def test_what_is_no_comparison_is_rejected(
    sources: list[str], message: str, tmp_path: Path
) -> None:
    run, empty = play(tmp_path / "run", SOME), play(tmp_path / "empty", {"sort": []})
    with pytest.raises(EvaluationError, match=message):
        read_entrants([source.format(run=run, empty=empty) for source in sources])


PAPER = paper_results()


def test_every_task_and_category_of_the_benchmark_is_there() -> None:
    tasks = [catalog.get(name) for name in catalog.names()]
    assert set(PAPER.tasks) == {task.id for task in tasks}
    for category in {str(task.category) for task in tasks}:
        members = {task.id for task in tasks if str(task.category) == category}
        assert PAPER.means[category].tasks == members
    assert PAPER.means["overall"].tasks == set(PAPER.tasks)


@pytest.mark.parametrize("policy", PAPER.policies)
def test_means_are_those_of_the_tasks_but_for_rounding(policy: str) -> None:
    for mean in PAPER.means.values():
        rates, progress = zip(*(PAPER.tasks[task][policy] for task in mean.tasks), strict=True)
        rate, average = mean.values[policy]
        assert rate == pytest.approx(fmean(rates), abs=0.51)
        assert average == pytest.approx(fmean(progress), abs=0.0101)


def test_numbers_are_those_of_the_page() -> None:
    (rows,) = (rows for rows in tables(ROOT / "docs" / "results.md") if "X-VLA" in rows[0])
    for row in rows:
        task = row["task"]
        values = PAPER.means["overall"].values if task == "overall" else PAPER.tasks[task]
        for policy, name in PAPER.policies.items():
            rate, progress = values[policy]
            assert row[name] == f"{rate:.0f} ({progress:.2f})".replace("(0.", "(.")


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
    assert value_of("ACT", tasks) == value


def test_unknown_policy_says_which_there_are() -> None:
    assert check_policy("paper:ACT") == "ACT"
    with pytest.raises(UnknownNameError, match="paper:pi05, paper:xvla"):
        check_policy("paper:act2")
