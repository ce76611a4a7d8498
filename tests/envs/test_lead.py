"""Targets lead joints by no more than they can follow, whatever is asked for."""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from duobench.core.types import SIDES
from duobench.envs.batch_env import BatchEnv
from duobench.envs.sim_env import sim_of
from duobench.world.robot.joints import SERVO_LAG, VELOCITY_LIMITS, duo_limits
from tests.envs.tools import make_small, vectors
from tests.quick_first import quick_first

STEPS, HOLD, FREE_STEPS = 240, 10, 20
JOINTS = np.delete(np.arange(16), [7, 15])
MOST = np.tile(VELOCITY_LIMITS, 2)
LIMITS = duo_limits(lag=SERVO_LAG)


def violence(seed: int, steps: int = STEPS) -> np.ndarray:
    """Ends of all ranges, other ends after some steps."""
    ends = np.random.default_rng([seed, HOLD]).integers(2, size=(steps // HOLD, 16))
    return np.repeat(np.where(ends, LIMITS.low, LIMITS.high), HOLD, axis=0)


@pytest.fixture(scope="module")
def env() -> Iterator[gym.Env]:
    env = make_small("bin_sort")
    yield env
    env.close()


@pytest.fixture
def several() -> Iterator[Callable[..., BatchEnv]]:
    """Makes vector environments on threads."""
    yield from vectors(threads=2)


@pytest.mark.parametrize("seed", quick_first(range(5), quick=2))
def test_no_joint_is_faster_than_it_may_be_in_free_air(env: gym.Env, seed: int) -> None:
    env.reset(seed=seed)
    simulation = sim_of(env).simulation
    roots = [simulation.model.body(f"{side}/link0").id for side in SIDES]
    robot = np.isin(simulation.model.body_rootid[simulation.model.geom_bodyid], roots)
    free, peaks, pushed = FREE_STEPS, [0.0], [0.0]
    interpolate = simulation.duo.interpolate
    seen: list[tuple[float, bool]] = []

    def watched(command):
        for _ in interpolate(command):
            yield
            contact = simulation.data.contact
            speed = np.abs(simulation.duo.joint_velocities().ravel() / MOST).max()
            seen.append((speed, bool(robot[contact.geom[contact.dist <= 0]].any())))

    simulation.duo.interpolate = watched
    for action in violence(seed):
        seen.clear()
        env.get_wrapper_attr("unwrapped").step(action)
        speeds, touched = zip(*seen, strict=True)
        free = 0 if any(touched) else free + 1
        (peaks if free >= FREE_STEPS else pushed).append(max(speeds))
    simulation.duo.interpolate = interpolate
    assert len(peaks) > FREE_STEPS
    assert 0.9 < max(peaks) < 1.1
    assert max(pushed) < 4.0


@pytest.mark.parametrize("seed", [0, 3])
def test_what_was_sent_is_sent_again_to_the_bit(env: gym.Env, seed: int) -> None:
    env.reset(seed=seed)
    steps = [env.step(action) for action in violence(seed, 80)]
    sent = [step[-1]["sent"] for step in steps]
    assert any(step[-1]["clipped"].any() for step in steps)
    last = env.get_wrapper_attr("state_hash")()
    env.reset(seed=seed)
    for target in sent:
        info = env.step(target)[-1]
        assert info["sent"].tobytes() == target.tobytes()
        assert not info["clipped"].any()
    assert env.get_wrapper_attr("state_hash")() == last


def test_an_episode_goes_on_from_a_saved_state_of_joints_that_are_behind(env: gym.Env) -> None:
    env.reset(seed=1)
    actions = violence(1, 60)
    for action in actions[:33]:
        env.step(action)
    state = env.get_wrapper_attr("save_state")()
    expected = [env.step(action)[-1]["sent"] for action in actions[33:]]
    env.get_wrapper_attr("restore_state")(state)
    again = [env.step(action)[-1]["sent"] for action in actions[33:]]
    assert np.array(again).tobytes() == np.array(expected).tobytes()


@pytest.mark.parametrize("options", [{}, {"speed_fraction": 0.5}], ids=["full speed", "half"])
def test_episodes_side_by_side_are_clipped_alike(
    several: Callable[..., BatchEnv], options: dict[str, Any]
) -> None:
    alone, vector = make_small("bin_sort", **options), several("bin_sort", **options)
    alone.reset(seed=4)
    vector.reset(seed=[4, 5])
    for action in violence(4, 60):
        one, many = alone.step(action)[-1], vector.step(np.stack([action, action]))[-1]
        assert one["sent"].tobytes() == many["sent"][0].tobytes()
        assert one["clipped"].tobytes() == many["clipped"][0].tobytes()
    assert vector.save_state(0).hash == alone.get_wrapper_attr("state_hash")()
    alone.close()


def test_a_target_that_is_clipped_is_one_that_is_not_clipped_again() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        last, measured = rng.uniform(LIMITS.low, LIMITS.high, (2, 16))
        velocities = rng.normal(0.0, 3.0, (2, 7))
        targets = rng.uniform(-4.0, 5.0, 16)
        once = LIMITS.clip(targets, last, measured, velocities)
        again = LIMITS.clip(once, last, measured, velocities)
        assert once.tobytes() == again.tobytes()
        assert (np.abs(once - last)[JOINTS] <= LIMITS.max_change[JOINTS] * (1 + 1e-12)).all()
        rows = LIMITS.clip(
            *(np.stack([each] * 3) for each in (targets, last, measured, velocities))
        )
        assert rows.tobytes() == np.stack([once] * 3).tobytes()


def test_a_reading_that_is_no_number_limits_nothing() -> None:
    unread = np.full(16, np.nan)
    last = np.zeros(16)
    moved = duo_limits().clip(LIMITS.high, last, unread, np.full((2, 7), np.nan))
    assert np.isfinite(moved).all()


def test_a_steady_joint_reaches_its_limit(env: gym.Env) -> None:
    env.reset(seed=0)
    base = sim_of(env)
    target = base.backend.last_command.flat
    speeds = []
    for _ in range(20):
        target[6] += MOST[6] / 30
        assert not env.step(target)[-1]["clipped"].any()
        speeds.append(base.backend.joint_velocities()[0, 6])
    assert all(before < after for before, after in pairwise(speeds[:5]))
    assert speeds[-1] == pytest.approx(MOST[6], rel=0.01)
