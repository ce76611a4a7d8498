import pytest

from duobench.results.metrics import task_result
from duobench.results.reporting.failures import failed_stages
from tests.results.samples import SORT, sample_record


def test_failures_stand_by_stage_with_what_did_not_hold() -> None:
    records = [
        sample_record(SORT, 0),
        sample_record(SORT, 1, (5,), unmet=("cube touches table", "left does not grasp cube")),
        sample_record(SORT, 2, (5,), unmet=("cube touches table",)),
        sample_record(SORT, 3, (5, 9), unmet=("bowl is empty",)),
        sample_record(SORT, 4, (), unmet=None),
    ]
    stages = failed_stages(task_result(SORT, records))
    assert [group.stage for group in stages] == [0, 1, 2]
    assert [[record.episode for record in group.records] for group in stages] == [[4], [1, 2], [3]]
    assert [[(one.count, one.text) for one in group.unmet] for group in stages] == [
        [],
        [(2, "cube touches table"), (1, "left does not grasp cube")],
        [(1, "bowl is empty")],
    ]
    assert [group.unexplained for group in stages] == [1, 0, 0]


def test_an_error_is_a_reason_of_its_own() -> None:
    record = sample_record(SORT, 0, (1, 2, 3), error="ValueError: no\n", unmet=("bowl is empty",))
    (group,) = failed_stages(task_result(SORT, [record]))
    assert (group.stage, group.errors, group.unexplained, group.unmet) == (3, 1, 0, ())


@pytest.mark.parametrize(
    ("said", "merged"),
    [
        (("20.4 mm above mat, not 12 mm", "9 mm above mat, not 12 mm"), "9 to 20.4 mm above mat, "),
        (("raised by -1.5 mm, not 12 mm", "raised by 0 mm, not 12 mm"), "raised by -1.5 to 0 mm, "),
        (("cube_1 at 0.50 m, not 12 mm", "cube_1 at 0.5 m, not 12 mm"), "cube_1 at 0.50 m, "),
    ],
)
def test_sentences_that_differ_in_numbers_are_one(said: tuple[str, ...], merged: str) -> None:
    records = [
        sample_record(SORT, episode, (5,), unmet=(text,)) for episode, text in enumerate(said)
    ]
    (group,) = failed_stages(task_result(SORT, records))
    assert [(one.count, one.text) for one in group.unmet] == [(2, f"{merged}not 12 mm")]


def test_names_with_other_numbers_stay_apart() -> None:
    records = [
        sample_record(SORT, episode, (5,), unmet=(f"cube_{episode} touches table",))
        for episode in range(2)
    ]
    (group,) = failed_stages(task_result(SORT, records))
    assert [one.count for one in group.unmet] == [1, 1]
