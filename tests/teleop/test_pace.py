"""When the world of a session runs, and when it stands still."""

from __future__ import annotations

import numpy as np
import pytest

from duobench.core.types import CONTROL_HZ, OPENING_SLOTS, Array, DuoState
from duobench.teleop.intent import Intent
from duobench.teleop.pace import LONGEST_REST_S, QUIET_S, Movement, Pace, Phase
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.mounts import HOME_JOINTS
from tests.quick_first import quick_first

LONGEST, QUIET = round(LONGEST_REST_S * CONTROL_HZ), round(QUIET_S * CONTROL_HZ)
MINUTE = round(60 * CONTROL_HZ)


def turn(pace: Pace, *, leads: bool = False, asked: float = 1.0, measured: float = 1.0) -> bool:
    """Whether the world runs in a turn; both grippers are asked for an opening, and have one."""
    action = np.zeros(16)
    action[list(OPENING_SLOTS)] = asked
    state = DuoState(
        joints=np.array(HOME_JOINTS),
        openings=np.full(2, measured),
        tcp_poses=ROBOT.tcp_poses(HOME_JOINTS),
    )
    return pace.runs(Intent(action=action, clutch=(leads, leads), leads=leads), state)


def steps(
    pace: Pace,
    turns: int,
    *,
    is_at_rest: bool = True,
    asked: float = 1.0,
    measured: float = 1.0,
) -> int:
    """The number of control steps in some turns that nobody leads."""
    count = 0
    for _ in range(turns):
        if turn(pace, asked=asked, measured=measured):
            pace.note_step(is_at_rest=is_at_rest)
            count += 1
    return count


def test_after_a_hand_let_go_the_world_goes_on_until_all_was_at_rest_for_a_while() -> None:
    pace = Pace()
    for _ in range(MINUTE):
        assert turn(pace, leads=True), "a clutch that is closed leads, though nothing moves"
        pace.note_step(is_at_rest=True)
    assert steps(pace, MINUTE) == QUIET
    assert pace.phase is Phase.STANDING
    assert turn(pace, leads=True)
    pace.note_step(is_at_rest=False)
    assert steps(pace, 20, is_at_rest=False) == 20
    assert pace.phase is Phase.RESTING
    assert steps(pace, QUIET - 1) == QUIET - 1
    assert steps(pace, 1, is_at_rest=False) == 1, "it stood still where it turned round"
    assert steps(pace, MINUTE) == QUIET


@pytest.mark.slow
def test_what_never_rests_is_waited_for_no_longer_than_three_seconds() -> None:
    pace = Pace()
    assert turn(pace, leads=True)
    pace.note_step(is_at_rest=False)
    assert steps(pace, MINUTE, is_at_rest=False) == LONGEST


def test_the_world_runs_alone_as_long_as_it_is_asked_to() -> None:
    pace = Pace()
    steps(pace, MINUTE)
    pace.is_alone = True
    assert steps(pace, MINUTE) == MINUTE
    assert pace.phase is Phase.ALONE
    pace.is_alone = False
    assert steps(pace, 10) == 0
    pace.is_alone = True
    pace.begin()
    assert not pace.is_alone, "it is asked for anew in each episode"


def test_fingers_lead_while_they_are_asked_to_move_and_while_they_do() -> None:
    pace = Pace()
    steps(pace, MINUTE)
    assert turn(pace, asked=0.0)
    for opening in np.linspace(1.0, 0.4, 150):  # a slow gripper takes five seconds
        assert turn(pace, asked=0.0, measured=float(opening))
        pace.note_step(is_at_rest=True)
    more = steps(pace, MINUTE, asked=0.0, measured=0.4)
    assert QUIET <= more < 2 * QUIET


@pytest.mark.parametrize("seed", quick_first(range(5)))
def test_the_noise_of_a_trigger_leads_nothing(seed: int) -> None:
    pace, draw = Pace(), np.random.default_rng(seed)
    steps(pace, MINUTE, asked=0.5)
    noise = draw.normal(0.5, 0.01, size=MINUTE)
    assert sum(turn(pace, asked=float(asked)) for asked in noise) == 0


def seen(motion: Array, noise: float = 1.0) -> list[bool]:
    movement = Movement([noise])
    return [movement.sees(number) for number in motion[:, None]]


def test_a_slow_motion_is_seen_as_a_quick_one_is_and_noise_is_not() -> None:
    assert any(seen(np.array([0.0, 0.0, 5.0]))), "at once"
    step = np.where(np.arange(30) < 15, 0.0, 1.1)
    assert any(seen(step)), "once, though it is hardly more than noise"
    slow = seen(np.arange(300) / 10)
    gaps = np.diff(np.flatnonzero(slow))
    assert gaps.max() < QUIET, "the world does not stop in between"
    trembling = np.where(np.arange(300) % 2, 1.2, 0.0)
    assert not any(seen(trembling))
