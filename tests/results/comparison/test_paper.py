from statistics import fmean

import pytest

from duobench.errors import UnknownNameError
from duobench.results.comparison.paper import check_policy, paper_results, value_of
from duobench.tasks import catalog
from tests.docs.markdown import ROOT, Row, tables

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
