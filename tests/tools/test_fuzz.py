"""Violent branches: what breaks is found, saved, and played again."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from dev.tools.fuzz import KEPT, MAX_DEPTH, Episode, Job, Limits, Watch, play, replay
from duobench.core.spatial import SE3
from duobench.envs.sim_env import sim_of
from duobench.world.robot.workcell import TABLE_X, TABLE_Y
from duobench.world.sim import simulation
from duobench.world.sim.simulation import Simulation

JOB = Job(task="transfer_gate", seed=0, branches=8, limits=Limits(link_speed=3.0))
"""Slow enough a limit that some branches break it, and the expert does not."""
EDGE = TABLE_X[1]
Begun = tuple[gym.Env, Simulation, Any, dict[str, Any]]


@pytest.fixture(scope="module")
def shared() -> Episode:
    return Episode("block_balance", 0, Limits())


@pytest.fixture
def episode(shared: Episode) -> Begun:
    return shared.env, sim_of(shared.env).simulation, *shared.env.reset(seed=0)


@pytest.mark.slow
def test_a_violation_is_named_saved_and_played_again(tmp_path: Path) -> None:
    broken = play(JOB).violations
    assert broken
    for violation in broken:
        assert str(violation).startswith("transfer_gate, seed 0, expert, branch ")
        assert f"step {len(violation.actions)}: " in str(violation)
        assert violation.what.endswith("m/s")
    first = broken[0]
    file = first.save(tmp_path)
    (again,) = replay(file, JOB.limits).violations
    assert (again.step, again.what) == (first.step, first.what)
    assert replay(file).violations == ()


@pytest.mark.slow
@pytest.mark.parametrize("file", sorted(KEPT.glob("*.npz")), ids=lambda file: file.stem)
def test_kept_episodes_break_an_engine_that_is_not_mended(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulation, "SOLVED", np.inf)
    (violation,) = replay(file).violations
    assert "badqacc" in violation.what or "m/s" in violation.what


@pytest.mark.parametrize(
    ("pose", "problem"),
    [
        (SE3.at(0.5, 0.0, -0.034), None),
        (SE3.at(0.5, 0.0, -0.06), "beam is "),
        (SE3.at(EDGE - 0.05, 0.0, -0.3), "beam is "),
        (SE3.at(EDGE + 0.2, 0.0, -0.3), None),
        (SE3.at(0.5, TABLE_Y[1] - 0.05, 0.03) @ SE3.about((1, 0, 0), -1.0), None),
    ],
    ids=["pressed in", "through", "below the edge", "beside", "hanging over the edge"],
)
def test_what_went_through_the_table_is_told_from_what_is_beside_it(
    episode: Begun, pose: SE3, problem: str | None
) -> None:
    env, sim, observation, info = episode
    sim.place("beam", pose)
    sim.forward()
    assert sim.min_height("beam") < -0.9 * MAX_DEPTH
    found = Watch(env, Limits()).problem(observation, info)
    assert found is None if problem is None else (found or "").startswith(problem)


def test_what_fell_beside_the_table_may_roll_under_it(episode: Begun) -> None:
    env, sim, observation, info = episode
    watch = Watch(env, Limits())
    for x in (EDGE + 0.2, EDGE - 0.2):
        sim.place("beam", SE3.at(x, 0.0, -0.7))
        sim.forward()
        assert watch.problem(observation, info) is None
    assert watch.fallen == {"beam"}


def test_a_state_that_is_not_finite_and_a_stage_that_falls_are_problems(episode: Begun) -> None:
    env, sim, observation, info = episode
    watch = Watch(env, Limits())
    assert watch.problem(observation, {**info, "stage": 2}) is None
    assert watch.problem(observation, {**info, "stage": 1}) == "stage 1 of 5 after stage 2"
    assert watch.problem(observation, {**info, "stage": 6}) == "stage 6 of 5 after stage 1"
    sim.data.qvel[-1] = np.nan
    assert watch.problem(observation, info) == "the state is not finite"
