"""The guard: what comes too near is refused, what experts do is not, and ways home are free."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from duobench.envs.protocol import make_env
from duobench.errors import BackendError
from duobench.evaluation import rollout
from duobench.evaluation.policies import ExpertPolicy
from duobench.hardware.devices import FaultKind
from duobench.hardware.guard import FINGER_MARGIN, MARGIN, PATH_STEP, Guard
from duobench.hardware.motion.follower import HIGHEST, LOWEST
from duobench.hardware.rig import Rig
from duobench.hardware.supervisor import State
from duobench.kinematics.inverse import Kinematics
from duobench.robot.frames import tcp_poses
from duobench.robot.joints import HOME_JOINTS
from duobench.types import SIDES, Array, DuoCommand
from tests.hardware.rigs import arm, joints, new_rig, ready_rig, speeds, wait

REAL_TASKS = ("hinge_chest", "ball_maze", "transfer_cube", "bin_sort")
"""What the paper rebuilt on the real robot."""


@pytest.fixture(scope="module")
def guard() -> Guard:
    return Guard()


def leaning(change: float) -> Array:
    """Home with both arms turned towards each other."""
    turned = HOME_JOINTS.copy()
    turned[0, 0] -= change
    turned[1, 0] += change
    return turned


def lowered() -> list[Array]:
    """Both hands led straight down from home, to 50 mm below the table."""
    kinematics, way = Kinematics(), [HOME_JOINTS]
    tools = kinematics.forward(HOME_JOINTS)
    heights = {side: tool.translation[2] for side, tool in tools.items()}
    for share in np.linspace(0.0, 1.0, 90):
        targets = {
            side: tool.moved(0.0, 0.0, -share * (heights[side] + 0.05))
            for side, tool in tools.items()
        }
        way.append(kinematics.step(way[-1], targets))
    return way


def test_nothing_is_near_at_home(guard: Guard) -> None:
    assert guard.problem(HOME_JOINTS) is None
    assert guard.nearest(HOME_JOINTS, 0.1) is None
    nearest = guard.nearest(HOME_JOINTS, 1.0)
    assert nearest is not None
    assert nearest.distance > 0.1


def test_arms_that_meet_are_refused_before_they_touch(guard: Guard) -> None:
    rooms = []
    for change in np.arange(0.0, 1.2, 0.02):
        nearest = guard.nearest(leaning(change), 1.0)
        assert nearest is not None
        rooms.append(nearest.room)
        if problem := guard.problem(leaning(change)):
            assert "left" in problem
            assert "right" in problem
            assert "mm is right" in problem
            assert nearest.distance > 0.0
            break
    assert rooms[-1] < 0.0 <= rooms[-2]


def test_fingers_reach_the_table_and_no_further(guard: Guard) -> None:
    way = lowered()
    number, problem = next((k, found) for k, q in enumerate(way) if (found := guard.problem(q)))
    assert "finger" in problem
    assert "the table" in problem
    heights = tcp_poses(way[number])[:, 2], tcp_poses(way[number - 1])[:, 2]
    assert -0.02 < min(heights[0]) < 0.02
    assert min(heights[1]) < 0.03


class Sent:
    """The joint targets of an episode."""

    def __init__(self) -> None:
        self.targets: list[Array] = []

    def on_episode_start(self, *_: Any) -> None: ...

    def on_step(self, step: Any) -> None:
        self.targets.append(DuoCommand.from_flat(step.info["sent"]).joints)

    def on_episode_end(self, *_: Any) -> None: ...


@pytest.fixture(scope="module", params=REAL_TASKS)
def expert(request: pytest.FixtureRequest) -> list[Array]:
    """Joint targets of an expert's episode of a task that the paper rebuilt."""
    env, sent = make_env(request.param, cameras=False), Sent()
    rollout(env, ExpertPolicy(env), seed=0, watchers=[sent])
    env.close()
    assert len(sent.targets) > 50
    return sent.targets


def test_what_experts_do_in_the_real_tasks_is_allowed(guard: Guard, expert: list[Array]) -> None:
    for targets in expert:
        assert guard.problem(targets) is None


def test_a_rig_plays_experts_at_half_tempo(expert: list[Array]) -> None:
    """With where the arms would come to rest looked at, too."""
    duo = ready_rig(replace(Rig.simulated(), cameras={}), guard=True)
    middles = [(one + other) / 2.0 for one, other in pairwise(expert)]
    for targets in [each for pair in zip(middles, expert[1:], strict=True) for each in pair]:
        duo.command(DuoCommand(joints=targets, openings=np.ones(2)))
        assert duo.held is None


def test_a_command_that_comes_too_near_holds_both_arms_and_counts_against_who_led() -> None:
    duo = ready_rig(guard=True)
    for number in range(1, 200):
        duo.command(DuoCommand(joints=leaning(0.01 * number), openings=np.ones(2)))
        if duo.held:
            break
    assert duo.held is not None
    assert duo.held.startswith("The guard refused a command")
    assert duo.fault is not None
    assert duo.fault.kind is FaultKind.REFLEX
    wait(duo, 0.5)
    assert np.abs(speeds(duo)).max() < 1e-3
    nearest = Guard().nearest(joints(duo), 1.0)
    assert nearest is not None
    assert nearest.distance > 0.5 * FINGER_MARGIN


def test_fast_arms_are_stopped_in_time_to_come_to_rest_before_they_meet() -> None:
    duo = ready_rig(guard=True)
    change = 0.0
    while not duo.held and change < 1.2:
        change += 0.034  # 1 rad/s, so that the followers are not behind
        duo.command(DuoCommand(joints=leaning(change), openings=np.ones(2)))
    wait(duo, 0.5)
    nearest = Guard().nearest(joints(duo), 1.0)
    assert nearest is not None
    assert nearest.distance > 0.5 * FINGER_MARGIN


def test_a_guard_that_fails_holds_both_arms(monkeypatch: pytest.MonkeyPatch) -> None:
    duo = ready_rig(guard=True)
    duo.command(DuoCommand(joints=HOME_JOINTS, openings=np.ones(2)))

    def fail(*_: Any) -> None:
        raise RuntimeError("no picture")

    monkeypatch.setattr(duo.guard, "problem", fail)
    duo.command(DuoCommand(joints=leaning(0.01), openings=np.ones(2)))
    assert duo.fault is not None
    assert duo.fault.kind is FaultKind.DEVICE
    assert "The guard failed" in (duo.held or "")
    assert "no picture" in duo.fault.text


def check_free(guard: Guard, start: Array, way: list[Array]) -> None:
    for there in way:
        steps = int(np.ceil(np.abs(there - start).max() / PATH_STEP)) or 1
        for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
            assert guard.problem(start + share * (there - start)) is None
        start = there


def test_the_way_home_is_straight_where_that_is_free(guard: Guard) -> None:
    start = leaning(-0.3)
    way = guard.way(start, HOME_JOINTS)
    assert len(way) == 1
    check_free(guard, start, way)


def crossed(guard: Guard) -> Array:
    """A free configuration from which the straight way home is not free."""
    rng = np.random.default_rng(0)
    while True:
        start = np.clip(HOME_JOINTS + rng.uniform(-0.9, 0.9, (2, 7)), LOWEST, HIGHEST)
        if guard.problem(start) is None:
            shares = np.linspace(0.0, 1.0, 60)[:, None, None]
            if any(guard.problem(p) for p in start + shares * (HOME_JOINTS - start)):
                return start


def test_the_way_home_goes_round_where_the_straight_one_is_not_free(guard: Guard) -> None:
    start = crossed(guard)
    way = guard.way(start, HOME_JOINTS)
    assert len(way) > 1
    assert np.array_equal(way[-1], HOME_JOINTS)
    check_free(guard, start, way)


def test_home_takes_the_way_that_the_guard_found(guard: Guard) -> None:
    start = crossed(guard)
    duo = new_rig(guard=True)
    for side in SIDES:
        arm(duo, side).put(start[side.index])
    duo.start()
    duo.supervisor.confirm()
    seen = []
    ticker = duo.clock.every(0.1, lambda: seen.append(joints(duo)), "camera")
    duo.home()
    ticker.stop()
    assert duo.supervisor.state is State.READY
    nearest = [guard.nearest(each, MARGIN) for each in seen]
    assert all(found is None or found.room > -0.005 for found in nearest)


def test_arms_without_a_free_way_are_left_to_people(monkeypatch: pytest.MonkeyPatch) -> None:
    guard = Guard()
    monkeypatch.setattr("duobench.hardware.motion.way.candidates", lambda _start, end: [[end]])
    start = crossed(guard)
    with pytest.raises(BackendError, match=r"No free way home .* by hand"):
        guard.way(start, HOME_JOINTS)
    duo = new_rig(guard=True)
    for side in SIDES:
        arm(duo, side).put(start[side.index])
    duo.start()
    duo.supervisor.confirm()
    with pytest.raises(BackendError, match="No free way home"):
        duo.home()
    assert [arm(duo, side).commands for side in SIDES] == [0, 0]


def test_arms_that_are_already_too_near_may_move_apart(guard: Guard) -> None:
    start = next(leaning(c) for c in np.arange(0.0, 1.2, 0.01) if guard.problem(leaning(c)))
    way = guard.way(start, HOME_JOINTS)
    assert np.array_equal(way[-1], HOME_JOINTS)


def test_a_ghost_shows_the_arms_where_they_are(guard: Guard) -> None:
    there = guard.ghost(HOME_JOINTS, ["head"], (90, 160))["head"]
    elsewhere = guard.ghost(leaning(-0.4), ["head"], (90, 160))["head"]
    assert there.shape == (90, 160, 3)
    changed = np.abs(there.astype(int) - elsewhere.astype(int)).max(axis=2) > 20
    assert 0.01 < changed.mean() < 0.6
    assert np.array_equal(guard.ghost(HOME_JOINTS, ["head"], (90, 160))["head"], there)
    guard.close()
