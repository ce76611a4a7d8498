from pathlib import Path
from statistics import fmean

import pytest

from duobench.errors import EvaluationError, UnknownNameError
from duobench.results.entrants import Group, read_entrants, split_name
from duobench.results.paper import check_policy, paper_results, value_of
from duobench.shifts.shift import Shift
from duobench.tasks import catalog
from tests.docs.markdown import ROOT, Row, tables
from tests.results.outcomes import play

SOME = {"sort": [3, 1, 0]}


def test_groups_stand_apart_and_letters_follow_them(tmp_path: Path) -> None:
    told = play(tmp_path / "told", SOME, "told", object_state=True)
    sees = play(tmp_path / "sees", SOME, "sees")
    expert = play(tmp_path / "expert", SOME, "expert")
    entrants = read_entrants(["paper:ACT", told, sees, expert])
    assert [(one.key, one.name, one.group) for one in entrants] == [
        ("A", "sees", Group.UNPRIVILEGED),
        ("B", "told", Group.PRIVILEGED),
        ("C", "expert", Group.PRIVILEGED),
        ("D", "ACT [paper]", Group.ELSEWHERE),
    ]


def test_equal_names_get_their_letter_and_given_names_stay(tmp_path: Path) -> None:
    one, other = (play(tmp_path / name, SOME) for name in ("one", "other"))
    assert [e.name for e in read_entrants([one, other])] == ["mine (A)", "mine (B)"]
    assert [e.name for e in read_entrants([f"small={one}", other])] == ["small", "mine"]


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
    run = play(tmp_path / "run", SOME)
    empty = play(tmp_path / "empty", {"sort": [0]})
    for record in Path(empty).glob("records/*/*/*.json"):
        record.unlink()
    with pytest.raises(EvaluationError, match=message):
        read_entrants([source.format(run=run, empty=empty) for source in sources])


PAPER = paper_results()


def readme() -> list[Row]:
    (rows,) = (rows for rows in tables(ROOT / "README.md") if "X-VLA" in rows[0])
    return rows


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


def test_numbers_are_those_of_the_readme() -> None:
    for row in readme():
        task = row["task"]
        values = PAPER.means["overall"].values if task == "overall" else PAPER.tasks[task]
        for policy, name in PAPER.policies.items():
            rate, progress = values[policy]
            assert row[name] == f"{rate:.0f} ({progress:.2f})".replace("(0.", "(.")


def test_a_mean_over_other_tasks_is_not_made_up() -> None:
    assert value_of("ACT", ["carry_pot"]) == (44, 0.63)
    assert value_of("ACT", ["hinge_chest", "spring_door", "pour_marbles"]) == (12, 0.25)
    assert value_of("ACT", ["hinge_chest", "spring_door"]) is None
    assert value_of("ACT", ["mine"]) is None


def test_unknown_policy_says_which_there_are() -> None:
    assert check_policy("paper:ACT") == "ACT"
    with pytest.raises(UnknownNameError, match="paper:pi05, paper:xvla"):
        check_policy("paper:act2")
