"""Targets beyond limits of the arms: when a run says so, and the largest numbers of a task."""

import pytest

from duobench.results.excess import Excess
from duobench.results.scores import clipping, task_result
from tests.results.samples import SORT, part_of, sample_record, sample_run


def excess(
    joint: tuple[float, float] = (0.0, 0.0),
    opening: tuple[float, float] = (1.0, 1.0),
    change: float = 0.0,
    first: tuple[float, float] = (0.0, 1.7),
    speed: float = 1.0,
) -> Excess:
    return Excess(joint=joint, opening=opening, change=change, first=first, speed=speed)


@pytest.mark.parametrize(
    ("clipped", "change", "is_far_off"),
    [(46, 0.06, True), (45, 9.0, False), (90, 0.04, False)],
)
def test_it_is_said_where_most_targets_were_changed_by_more_than_a_trifle(
    clipped: int, change: float, is_far_off: bool
) -> None:
    records = [
        sample_record(SORT, 0, (5,), clipped=clipped, excess=excess(change=change)),
        sample_record(SORT, 1, (5,), clipped=1, excess=excess(change=9.0)),
        sample_record(SORT, 2),
    ]
    assert part_of(sample_run(episodes=3), records).is_far_off == is_far_off


def test_a_task_has_the_largest_of_every_number() -> None:
    records = [
        sample_record(
            SORT, 0, (5,), clipped=7, excess=excess(joint=(-147.8, -3.0), change=0.2, speed=2.5)
        ),
        sample_record(
            SORT, 1, (5,), clipped=1, excess=excess(joint=(90.0, 2.7), opening=(255.0, 1.0))
        ),
        sample_record(SORT, 2, clipped=0, excess=None),
    ]
    found = clipping(task_result(SORT, records))
    assert found is not None
    assert (found.steps, found.episodes, found.all_episodes) == (8, 2, 3)
    expected = excess(joint=(-147.8, -3.0), opening=(255.0, 1.0), change=0.2, speed=2.5)
    assert found.excess == expected
    assert clipping(task_result(SORT, records[2:])) is None
