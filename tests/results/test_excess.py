"""What explains targets beyond limits of the arms, and what does not."""

import pytest

from duobench.results.excess import Excess
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
    ("one", "question"),
    [
        (excess(joint=(175.0, 2.744)), "are these degrees?"),
        (excess(joint=(-147.8, -3.042)), "are these degrees?"),
        (excess(joint=(12.5, 2.744)), ""),
        (excess(joint=(300.0, 2.744)), ""),
        (excess(joint=(-90.0, 0.544)), ""),
        (excess(joint=(1e30, 2.744)), ""),
        (excess(opening=(255.0, 1.0)), "are openings 0 to 100 or 255?"),
        (excess(opening=(10.0, 1.0)), "are openings 0 to 100 or 255?"),
        (excess(opening=(1.2, 1.0)), ""),
        (excess(opening=(256.0, 1.0)), ""),
        (excess(opening=(-20.0, 0.0)), ""),
        (excess(first=(1.7, 0.1)), "are the arms in the other order?"),
        (excess(first=(1.7, 0.6)), ""),
        (excess(first=(0.4, 0.0)), ""),
        (excess(), ""),
    ],
    ids=str,
)
def test_a_mistake_explains_what_was_requested(one: Excess, question: str) -> None:
    assert one.questions == [question] * bool(question)


def test_joints_that_turned_faster_than_they_may_are_told() -> None:
    assert "joints turned at 2.6 times their speed limits" in str(excess(speed=2.56))
    assert "turned" not in str(excess(speed=1.1))


@pytest.mark.parametrize(
    ("clipped", "change", "is_told"),
    [(46, 0.06, True), (45, 9.0, False), (90, 0.04, False)],
)
def test_it_is_told_where_most_targets_were_changed_by_more_than_a_trifle(
    clipped: int, change: float, is_told: bool
) -> None:
    records = [
        sample_record(SORT, 0, (5,), clipped=clipped, excess=excess(change=change)),
        sample_record(SORT, 1, (5,), clipped=1, excess=excess(change=9.0)),
        sample_record(SORT, 2),
    ]
    words = (
        f"Limits of the arms changed what was to be sent in {clipped} of 90 control steps of 1 of "
        f"3 episodes: joints were to move {change} rad too far in a step."
    )
    assert part_of(sample_run(episodes=3), records).excess == words * is_told
