"""References: bounded, smooth, and exactly at rest at the end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from duobench.core.errors import ActionError
from duobench.core.types import Side
from duobench.real.follower import HIGHEST, LOWEST, MAX_STEP_S, PERIOD, Follower
from duobench.real.rig import (
    FOLLOWER_HZ,
    MAX_ACCELERATION,
    MAX_SPEED_FRACTION,
    MAX_TOOL_SPEED,
    ArmConfig,
)
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.joints import JOINT_RANGES, VELOCITY_LIMITS, speed_limits
from duobench.world.robot.mounts import HOME_JOINTS

HOME = HOME_JOINTS[0]
DT = 1.0 / FOLLOWER_HZ
FULL = ArmConfig(
    speed_fraction=MAX_SPEED_FRACTION, acceleration=MAX_ACCELERATION, tool_speed=MAX_TOOL_SPEED
)


def by_samples(
    few: int, every: int, mark: pytest.MarkDecorator = pytest.mark.slow
) -> pytest.MarkDecorator:
    """Try a property with a few samples, and under a mark with all of them."""
    return pytest.mark.parametrize("samples", [few, pytest.param(every, marks=mark)])


def play(
    follower: Follower, targets: list[np.ndarray], rest: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Aim at targets thirty times a second, then at nothing new; return positions and speeds."""
    points, calls, time = [], 0, 0.0
    for number in range(len(targets) + round(rest / PERIOD)):
        if number < len(targets):
            follower.aim(targets[number])
        while time < (number + 1) * PERIOD - 1e-9:
            points.append(follower.advance(DT))
            calls += 1
            time = calls * DT
    positions, speeds = zip(*points, strict=True)
    return np.array(positions), np.array(speeds)


def check_bounds(positions: np.ndarray, speeds: np.ndarray, limits: ArmConfig) -> None:
    """What no path may break, whatever it was told."""
    assert positions == pytest.approx(np.clip(positions, LOWEST, HIGHEST), abs=1e-9)
    for before, speed in zip(positions, speeds[1:], strict=False):
        low, high = speed_limits(before)
        assert (speed >= limits.speed_fraction * low - 1e-9).all()
        assert (speed <= limits.speed_fraction * high + 1e-9).all()
    assert np.abs(np.diff(speeds, axis=0)).max() <= limits.acceleration * DT * (1 + 1e-6)


def test_a_slow_path_is_followed_without_lag() -> None:
    follower = Follower(HOME, FULL, ROBOT)
    times = np.arange(90) / 30.0
    targets = [HOME + 0.15 * (1 - np.cos(2.0 * t)) for t in times]
    positions, speeds = play(follower, targets)
    check_bounds(positions, speeds, FULL)
    # Each point against the straight line between the targets before and after it.
    times = (np.arange(len(positions)) + 1) * DT
    lines = np.array([HOME, *targets]).T
    straight = np.array([np.interp(times, np.arange(91) * PERIOD, line) for line in lines]).T
    assert np.median(np.abs(positions - straight)) < 2e-3
    assert np.abs(positions - straight).max() < 0.02


@pytest.mark.parametrize("fraction", [0.1, 0.5])
def test_a_far_target_is_approached_within_bounds_and_not_overshot(fraction: float) -> None:
    limits = replace(FULL, speed_fraction=fraction)
    follower = Follower(HOME, limits, ROBOT)
    goal = HOME + np.array([0.5, -0.5, 0.5, 0.5, -0.5, 0.5, 0.5])
    positions, speeds = play(follower, [goal], rest=6.0)
    check_bounds(positions, speeds, limits)
    assert positions[-1] == pytest.approx(goal, abs=1e-4)
    assert (np.abs(positions - HOME).max(axis=0) <= 0.5 + 0.01).all()


@by_samples(40, 200)
def test_whatever_is_told_no_bound_is_broken(samples: int) -> None:
    rng = np.random.default_rng(0)
    low, high = JOINT_RANGES.T
    for fraction, acceleration in ((0.5, MAX_ACCELERATION), (0.25, 4.0)):
        limits = ArmConfig(speed_fraction=fraction, acceleration=acceleration)
        follower = Follower(HOME, limits, ROBOT)
        targets = [rng.uniform(low - 0.5, high + 0.5) for _ in range(samples)]
        targets += [low] * 90 + [high] * 90
        check_bounds(*play(follower, targets), limits)


@by_samples(30, 90)
@pytest.mark.parametrize("most", [0.1, 0.25, 1.0])
def test_whatever_is_told_the_tool_is_not_faster_than_it_may_be(most: float, samples: int) -> None:
    rng = np.random.default_rng(1)
    low, high = JOINT_RANGES.T
    limits = replace(FULL, tool_speed=most)
    fastest = []
    for targets in (
        [rng.uniform(low, high) for _ in range(samples)],
        [HOME + rng.uniform(-0.6, 0.6, 7) for _ in range(samples)],
        [each for _ in range(samples // 15) for each in [rng.uniform(low, high)] * 15],
        [HOME + 0.6 * np.sign(np.sin(0.4 * number)) for number in range(samples)],
    ):
        follower = Follower(HOME, limits, ROBOT)
        positions, speeds = play(follower, targets, rest=1.0)
        check_bounds(positions, speeds, limits)
        places, _ = ROBOT.tool_frames(Side.LEFT, positions)
        fastest.append(np.linalg.norm(np.diff(places, axis=0), axis=1).max() / DT)
        assert follower.is_at_rest or np.abs(positions[-1] - targets[-1]).max() > 0.1
    assert 0.9 * most < max(fastest) < 1.12 * most


def test_a_tool_that_may_not_be_fast_gets_where_it_is_led() -> None:
    follower, goal = Follower(HOME, replace(FULL, tool_speed=0.1), ROBOT), HOME + 0.3
    positions, _ = play(follower, [goal], rest=6.0)
    assert positions[-1] == pytest.approx(goal, abs=1e-4)


def test_tools_move_with_joints_as_their_jacobians_say() -> None:
    rng = np.random.default_rng(2)
    for _ in range(10):
        joints, change = (
            HOME_JOINTS + rng.uniform(-1.0, 1.0, (2, 7)),
            1e-6 * rng.normal(size=(2, 7)),
        )
        moved = ROBOT.tcp_poses(joints + change)[:, :3] - ROBOT.tcp_poses(joints - change)[:, :3]
        told = np.einsum("sij,sj->si", ROBOT.tool_jacobians(joints), 2.0 * change)
        assert np.linalg.norm(told, axis=1) == pytest.approx(
            np.linalg.norm(moved, axis=1), rel=1e-5
        )


def test_targets_keep_away_from_the_ends_of_the_range() -> None:
    follower = Follower(HOME, FULL, ROBOT)
    for beyond, end in ((JOINT_RANGES[:, 1] + 1.0, HIGHEST), (JOINT_RANGES[:, 0], LOWEST)):
        positions, _ = play(follower, [beyond], rest=6.0)
        assert positions[-1] == pytest.approx(end, abs=1e-4)
    assert pytest.approx(JOINT_RANGES[:, 1] - 0.05) == HIGHEST
    assert pytest.approx(JOINT_RANGES[:, 0] + 0.05) == LOWEST


def test_the_reference_stops_at_the_last_target_when_no_other_comes() -> None:
    follower = Follower(HOME, FULL, ROBOT)
    targets = [HOME + 0.03 * number for number in range(1, 13)]  # 0.9 rad/s
    positions, speeds = play(follower, targets, rest=1.0)
    assert np.array_equal(speeds[-1], np.zeros(7))
    assert positions[-1] == pytest.approx(targets[-1], abs=1e-4)
    # Never beyond what braking takes, and after two periods no further behind.
    braking = 0.9**2 / (2 * MAX_ACCELERATION) + 1e-3
    assert (positions - targets[-1]).max() <= braking
    stalled = positions[round((len(targets) + 2) * PERIOD / DT) :]
    assert np.abs(stalled - targets[-1]).max() <= braking


def test_a_hold_comes_to_rest_as_fast_as_it_may_and_stays_there() -> None:
    follower = Follower(HOME, FULL, ROBOT)
    play(follower, [HOME + 0.03 * number for number in range(1, 13)])
    speed = np.abs(follower.velocity).max()
    follower.hold()
    calls = 0
    while not follower.is_at_rest:
        follower.advance(DT)
        calls += 1
    assert calls * DT <= speed / MAX_ACCELERATION + 2 * DT
    where = follower.reference
    follower.advance(DT)
    assert np.array_equal(follower.reference, where)
    follower.aim(where)
    follower.advance(DT)
    assert follower.reference == pytest.approx(where, abs=1e-12)


def test_after_a_freeze_the_reference_goes_on_without_a_leap() -> None:
    follower = Follower(HOME, FULL, ROBOT)
    follower.aim(HOME + 1.0)
    before = follower.advance(DT)[0]
    after = follower.advance(5.0)[0]
    assert np.abs(after - before).max() <= 0.5 * max(VELOCITY_LIMITS) * MAX_STEP_S


def test_the_same_calls_give_the_same_path() -> None:
    targets = [*(HOME + np.random.default_rng(1).normal(0, 0.1, (30, 7)))]
    one, other = (play(Follower(HOME, FULL, ROBOT), targets)[0] for _ in range(2))
    assert np.array_equal(one, other)


@pytest.mark.parametrize("wrong", [np.full(7, np.nan), np.zeros(6), np.zeros((7, 1))])
def test_what_is_no_joint_position_is_refused_and_changes_nothing(wrong: np.ndarray) -> None:
    follower = Follower(HOME, FULL, ROBOT)
    with pytest.raises(ActionError, match="7 finite joint positions"):
        follower.aim(wrong)
    follower.advance(DT)
    assert np.array_equal(follower.reference, HOME)


def test_near_an_end_of_its_range_a_joint_may_only_move_slowly_towards_it() -> None:
    low, high = speed_limits(HOME)
    assert np.array_equal(high[2:3], [VELOCITY_LIMITS[2]])
    end = JOINT_RANGES[:, 1]
    low, high = speed_limits(end)
    assert np.array_equal(high, np.zeros(7))
    assert (low == -np.array(VELOCITY_LIMITS)).all()
    _, nearly = speed_limits(end - 0.1)
    assert (nearly < np.array(VELOCITY_LIMITS)).all()
    assert (nearly > 0.0).all()


@pytest.mark.parametrize("acceleration", [1.0, 4.0, MAX_ACCELERATION])
@by_samples(40, 150)
@pytest.mark.parametrize("seed", range(2))
def test_no_order_of_calls_breaks_a_bound(seed: int, acceleration: float, samples: int) -> None:
    """Targets, holds, resets to where it is told to be, limits and uneven calls at random."""
    rng = np.random.default_rng(seed)
    follower = Follower(HOME, replace(FULL, acceleration=acceleration), ROBOT)
    low, high = JOINT_RANGES.T
    slowing = 0.0
    """Seconds in which a speed that was allowed before may still be too fast."""
    for _ in range(samples):
        match rng.integers(6):
            case 0:
                follower.hold()
            case 1:
                fraction = float(rng.choice([0.02, 0.1, 0.25, MAX_SPEED_FRACTION]))
                slowing = max(VELOCITY_LIMITS) * MAX_SPEED_FRACTION / acceleration
                follower.speed_fraction = fraction
            case 2 if follower.is_at_rest:
                follower.reset(follower.reference)
            case _:
                follower.aim(rng.uniform(low - 0.5, high + 0.5))
        for _ in range(rng.integers(1, 20)):
            dt = float(rng.choice([DT, rng.uniform(1e-4, MAX_STEP_S), 10.0]))
            before, lowest_highest = follower.velocity, speed_limits(follower.reference)
            joints, speed = follower.advance(dt)
            took = min(dt, MAX_STEP_S)
            assert np.abs(speed - before).max() <= acceleration * took * (1 + 1e-9)
            assert joints == pytest.approx(np.clip(joints, LOWEST, HIGHEST), abs=1e-9)
            slowing -= took
            allowed = follower.speed_fraction if slowing < 0.0 else MAX_SPEED_FRACTION
            slowest, fastest = (allowed * each for each in lowest_highest)
            # Where the limits fall faster than a slow arm brakes, its own braking bounds it.
            assert (speed >= np.minimum(slowest, before + acceleration * took) - 1e-9).all()
            assert (speed <= np.maximum(fastest, before - acceleration * took) + 1e-9).all()
            assert (speed >= lowest_highest[0] - 1e-9).all()
            assert (speed <= lowest_highest[1] + 1e-9).all()


@by_samples(100, 10_000, pytest.mark.long)
def test_resets_in_full_motion_keep_the_acceleration(samples: int) -> None:
    """A limit that narrows to a tenth in any motion, with and without a hold before it."""
    rng = np.random.default_rng(0)
    follower, fastest = Follower(HOME, FULL, ROBOT), 0.0
    middle = JOINT_RANGES.mean(axis=1)
    for number in range(samples):
        follower.speed_fraction = FULL.speed_fraction
        follower.aim(middle + rng.uniform(-1.0, 1.0, 7))
        speeds = [follower.advance(MAX_STEP_S)[1] for _ in range(rng.integers(6, 18))]
        fastest = max(fastest, np.abs(speeds[-1]).max())
        follower.speed_fraction = 0.1
        if number % 2:
            follower.hold()
        else:
            follower.aim(HOME)
        speeds += [follower.advance(DT)[1] for _ in range(4)]
        changes = np.abs(np.diff(speeds, axis=0)).max(axis=1)
        steps = np.array([MAX_STEP_S] * (len(changes) - 4) + [DT] * 4)
        assert (changes <= MAX_ACCELERATION * steps * (1 + 1e-9)).all()
    assert fastest > 0.9
