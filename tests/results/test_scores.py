import random

import pytest

from duobench.results.scores import (
    failed_stages,
    progress_curve,
    summarize,
    task_result,
    wilson_interval,
)
from tests.results.samples import LIFT, SORT, TASKS, sample_record, sample_records, sample_run


def test_scores_of_a_task_are_counts_over_its_episodes() -> None:
    records = [
        sample_record(SORT, 0, (1, 2, 3)),
        sample_record(SORT, 1, (4,)),
        sample_record(SORT, 2, ()),
        sample_record(SORT, 3, (5,), error="boom"),
        sample_record(LIFT, 0, (5,)),
    ]
    result = task_result(SORT, records)
    found = result.score
    assert (found.episodes, found.successes, found.errors) == (4, 1, 1)
    assert (found.success_rate, found.interval) == (0.25, wilson_interval(1, 4))
    assert found.mean_final_progress == pytest.approx((1 + 1 / 3 + 0 + 1 / 3) / 4)
    assert result.last_stage_counts == (1, 2, 0, 1)
    broken = task_result(SORT, [sample_record(SORT, 0, (1, 2, 3), error="boom")])
    assert broken.score.successes == 0  # though it reached the last stage


def test_curve_is_the_mean_stage_at_each_share_of_the_horizon() -> None:
    records = [sample_record(LIFT, 0, (50, 100)), sample_record(LIFT, 1, (151,))]
    curve = progress_curve(records, LIFT.horizon)
    assert curve == (*[0.0] * 25, *[0.25] * 25, *[0.5] * 26, *[0.75] * 25)


@pytest.mark.parametrize("seed", range(5))
def test_curve_never_falls_and_ends_at_the_mean_final_progress(seed: int) -> None:
    run = sample_run(episodes=7)
    for one in summarize(run.suite.tasks, sample_records(run, seed)).tasks:
        assert list(one.progress) == sorted(one.progress)
        assert one.progress[-1] == pytest.approx(one.score.mean_final_progress)
        assert sum(one.last_stage_counts) == one.score.episodes


def test_results_do_not_depend_on_the_order_of_the_records() -> None:
    run = sample_run(episodes=9)
    records = sample_records(run)
    expected = summarize(run.suite.tasks, records)
    for seed in range(3):
        random.Random(seed).shuffle(records)
        assert summarize(run.suite.tasks, records) == expected


def test_categories_and_the_overall_row_pool_episodes() -> None:
    run = sample_run(episodes=6)
    found = summarize(run.suite.tasks, sample_records(run))
    by_id = {one.task.id: one.score for one in found.tasks}
    bimanual, parallel = found.categories
    assert (bimanual.label, parallel.label) == ("bimanual manipulation", "parallel execution")
    assert bimanual.episodes == 12
    assert bimanual.successes == by_id["lift"].successes + by_id["turn"].successes
    assert parallel.mean_final_progress == by_id["sort"].mean_final_progress
    rates = [score.success_rate or 0.0 for score in by_id.values()]
    assert found.overall.success_rate == pytest.approx(sum(rates) / len(rates))


def test_run_without_records_has_no_rates() -> None:
    found = summarize(TASKS, [])
    overall = found.overall
    assert (overall.success_rate, overall.mean_final_progress) == (None, None)
    assert overall.interval == (0.0, 1.0)
    assert [one.progress for one in found.tasks] == [(), (), ()]


def test_failures_stand_by_stage_with_what_did_not_hold() -> None:
    records = [
        sample_record(SORT, 0),
        sample_record(SORT, 1, (5,), unmet=("cube touches table", "left does not grasp cube")),
        sample_record(SORT, 2, (5,), unmet=("cube touches table",)),
        sample_record(SORT, 3, (5, 9), unmet=("bowl is empty",)),
        sample_record(SORT, 4, (), unmet=None),
    ]
    stages = failed_stages(task_result(SORT, records))
    found = [
        (group.stage, [record.episode for record in group.records], group.unmet, group.unexplained)
        for group in stages
    ]
    assert found == [
        (0, [4], (), 1),
        (1, [1, 2], ((2, "cube touches table"), (1, "left does not grasp cube")), 0),
        (2, [3], ((1, "bowl is empty"),), 0),
    ]


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
        (("cube_0 touches table", "cube_1 touches table"), None),  # names, which stay apart
        (("part # #", "part # 5"), None),  # forged
    ],
)
def test_sentences_that_differ_in_numbers_are_one(said: tuple[str, ...], merged: str) -> None:
    records = [
        sample_record(SORT, episode, (5,), unmet=(text,)) for episode, text in enumerate(said)
    ]
    (group,) = failed_stages(task_result(SORT, records))
    apart = tuple((1, text) for text in said)
    assert group.unmet == (((2, f"{merged}not 12 mm"),) if merged else apart)
