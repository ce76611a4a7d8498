"""The clutch between a hand and a tool, and how old a sample is by the clock of who sent it."""

import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.teleop.hands import WINDOW_S, Clutch, Freshness
from duobench.teleop.messages import Hand, Hands
from tests.teleop.operator import hand, message, said

TOOL = SE3.about((1, 2, 3), 2.0) @ SE3.at(0.4, 0.1, 0.2)
HELD = SE3.about((3, 1, 2), 1.0)
AHEAD_MS = 7.3e8
"""What the sender's clock shows when ours is at zero: a page that has been open for a week."""
RATE = 60


def sample(pose: SE3, squeeze: float, *, sure: bool = True) -> Hand:
    hands = said(message(0, hand(pose, squeeze=squeeze) | {"sure": sure}, None))
    assert isinstance(hands, Hands)
    assert hands.left is not None
    return hands.left


def closed() -> Clutch:
    """A clutch that was closed by a hand at `HELD`."""
    clutch = Clutch()
    assert clutch.follow(sample(HELD, 0.0), TOOL) is None
    assert clutch.follow(sample(HELD, 1.0), TOOL) is not None
    return clutch


def turned(pose: SE3, axis: tuple[float, float, float]) -> SE3:
    return SE3((SE3.about(axis, 0.6) @ pose).rotation, pose.translation)


@pytest.mark.parametrize(
    ("hand_pose", "expected"),
    [
        (HELD, TOOL),
        (HELD.moved(0.05, 0.0, 0.10), TOOL.moved(0.05, 0.0, 0.10)),
        *((turned(HELD, a), turned(TOOL, a)) for a in ((1, 0, 0), (0, 1, 0), (1, -1, 2))),
    ],
)
def test_the_tool_moves_as_the_hand_does_along_the_axes_of_the_room(
    hand_pose: SE3, expected: SE3
) -> None:
    found = closed().follow(sample(hand_pose, 1.0), TOOL)
    assert found is not None
    assert max(found.distance(expected)) < 1e-9


@pytest.mark.parametrize(
    ("clutch", "steps"),
    [
        pytest.param(
            closed(),
            [
                (0.1, 1.0, 0.1),
                (0.1, 0.0, None),
                (0.0, 0.0, None),
                (-0.3, 0.0, None),
                (-0.3, 1.0, 0.1),
                (-0.28, 1.0, 0.12),
            ],
            id="release, return and squeeze move nothing",
        ),
        pytest.param(
            Clutch(),
            [(0.0, 1.0, None), (0.2, 1.0, None)],
            id="a squeeze that was never released leads nothing",
        ),
        *(
            pytest.param(
                closed(),
                [(gone, 1.0, None), (0.3, 1.0, None), (0.3, 0.0, None), (0.3, 1.0, 0.0)],
                id=f"a hand that was {name} needs a release and a new squeeze",
            )
            for name, gone in (("lost", None), ("unsure", "unsure"))
        ),
        pytest.param(
            closed(),
            [
                (0.0, 0.49, 0.0),
                (0.0, 0.55, 0.0),
                (0.0, 0.31, 0.0),
                (0.0, 0.5, 0.0),
                (0.0, 0.29, None),
                (0.0, 0.49, None),
                (0.0, 0.5, 0.0),
            ],
            id="a trembling finger does not let go",
        ),
    ],
)
def test_a_clutch_closes_on_a_squeeze_after_a_release(
    clutch: Clutch, steps: list[tuple[float | str | None, float, float | None]]
) -> None:
    """Each step: the shift of the hand along y, its squeeze, and the shift of the tool."""
    tool = TOOL
    for shift, squeeze, expected in steps:
        match shift:
            case None:
                seen = None
            case str():
                seen = sample(HELD, squeeze, sure=False)
            case _:
                seen = sample(HELD.moved(y=shift), squeeze)
        found = clutch.follow(seen, tool)
        assert (found is None) == (expected is None), (shift, squeeze)
        if found is not None and expected is not None:
            assert max(found.distance(TOOL.moved(y=expected))) < 1e-9
            tool = found


def test_what_a_hand_does_between_two_control_steps_is_led() -> None:
    clutch = Clutch()
    for pose, squeeze in ((HELD, 0.0), (HELD, 1.0), (HELD.moved(0.0, 0.0, 0.005), 1.0)):
        clutch.notice(sample(pose, squeeze))
    led = clutch.follow(sample(HELD.moved(0.0, 0.0, 0.005), 1.0), TOOL)
    assert led is not None
    assert max(led.distance(TOOL.moved(0.0, 0.0, 0.005))) < 1e-9


def test_what_arrives_in_time_is_fresh_whatever_the_clocks_show() -> None:
    freshness, rng = Freshness(), np.random.default_rng(0)
    arrival = 0.0
    for number in range(600):
        sent = number / RATE
        arrival = max(arrival, sent + 0.002 + rng.exponential(0.01))
        assert freshness.accepts(AHEAD_MS + 1000 * sent, arrival)
    assert freshness.dropped == 0


def test_the_burst_after_a_stall_is_dropped_but_for_its_end() -> None:
    freshness = Freshness()
    for number in range(RATE):
        assert freshness.accepts(AHEAD_MS + 1000 * number / RATE, number / RATE)
    stalled = range(RATE, 5 * RATE)
    accepted = [n for n in stalled if freshness.accepts(AHEAD_MS + 1000 * n / RATE, 5.0)]
    assert max(5.0 - n / RATE for n in accepted) <= 0.25
    assert len(accepted) + freshness.dropped == len(stalled)
    assert len(accepted) in {14, 15}
    assert freshness.accepts(AHEAD_MS + 5000, 5.0)


def test_a_sample_is_used_once() -> None:
    freshness = Freshness()
    samples = ((100.0, 1.0), (100.0, 1.01), (90.0, 1.02), (130.0, 1.03))
    assert [freshness.accepts(*each) for each in samples] == [True, False, False, True]


def test_clocks_that_drift_apart_for_an_hour_stay_fresh() -> None:
    freshness, drift, seconds = Freshness(), 2e-4, 3600
    for number in range(10 * seconds):
        assert freshness.accepts(100 * number * (1 - drift), number / 10), number
    assert seconds * drift > 0.25


def test_a_sender_that_slept_is_fresh_again_after_two_windows() -> None:
    freshness = Freshness()
    assert freshness.accepts(0.0, 0.0)
    answers = [
        freshness.accepts(1000 * (number / 10 + 0.1), 100.0 + number / 10)
        for number in range(int(20 * WINDOW_S) + 10)
    ]
    assert not answers[int(WINDOW_S * 10) - 10]
    assert answers[-1]
