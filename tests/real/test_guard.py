"""The guard: what comes too near is refused, what experts do is not, and ways home are free."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import BackendError
from duobench.core.spatial import SE3
from duobench.core.types import SIDES, Array, DuoCommand
from duobench.real.cell import Obstacle, Workspace
from duobench.real.env import make_real_env
from duobench.real.follower import HIGHEST, LOWEST
from duobench.real.guard import FINGER_MARGIN, MARGIN, PATH_STEP, Guard
from duobench.real.supervisor import State
from duobench.results.labels import FaultKind
from duobench.tasks import catalog
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.mounts import HOME_JOINTS
from duobench.world.sim.layout import Layout
from tests.real.rigs import (
    arm,
    confirmed,
    half_tempo,
    joints,
    new_rig,
    put,
    ready_rig,
    speeds,
    wait,
)
from tests.real.simulated import simulated_rig

REAL_TASKS = ("hinge_chest", "ball_maze", "transfer_cube", "bin_sort")
"""What the paper rebuilt on the real robot."""


@pytest.fixture(scope="module")
def guard() -> Guard:
    return Guard(ROBOT)


def leaning(change: float) -> Array:
    """Home with both arms turned towards each other."""
    turned = HOME_JOINTS.copy()
    turned[0, 0] -= change
    turned[1, 0] += change
    return turned


def lowered() -> list[Array]:
    """Both hands led straight down from home, to 50 mm below the table."""
    kinematics, way = Kinematics(ROBOT), [HOME_JOINTS]
    tools = kinematics.forward(HOME_JOINTS)
    heights = {side: tool.translation[2] for side, tool in tools.items()}
    for share in np.linspace(0.0, 1.0, 90):
        targets = {
            side: tool.moved(0.0, 0.0, -share * (heights[side] + 0.05))
            for side, tool in tools.items()
        }
        way.append(kinematics.step(way[-1], targets))
    return way


def distance(guard: Guard, joints: Array) -> float:
    """How near the two parts with the least room are."""
    nearest = guard.nearest(joints, 1.0)
    assert nearest is not None
    return nearest.distance


def test_nothing_is_near_at_home(guard: Guard) -> None:
    assert guard.problem(HOME_JOINTS) is None
    assert guard.nearest(HOME_JOINTS, 0.1) is None
    assert distance(guard, HOME_JOINTS) > 0.1


def test_arms_that_meet_are_refused_before_they_touch(guard: Guard) -> None:
    meeting = next(c for c in np.arange(0.0, 1.2, 0.02) if guard.problem(leaning(c)))
    rooms = [guard.nearest(leaning(change), 1.0) for change in (meeting - 0.02, meeting)]
    assert [found is not None and found.room >= 0.0 for found in rooms] == [True, False]
    assert distance(guard, leaning(meeting)) > 0.0
    problem = guard.problem(leaning(meeting)) or ""
    assert [word in problem for word in ("left", "right", "mm is right")] == [True] * 3


def test_fingers_reach_the_table_and_no_further(guard: Guard) -> None:
    way = lowered()
    number, problem = next((k, found) for k, q in enumerate(way) if (found := guard.problem(q)))
    assert "finger" in problem
    assert "the table" in problem
    heights = ROBOT.tcp_poses(way[number])[:, 2], ROBOT.tcp_poses(way[number - 1])[:, 2]
    assert -0.02 < min(heights[0]) < 0.02
    assert min(heights[1]) < 0.03


@pytest.mark.long
@pytest.mark.parametrize("task", REAL_TASKS)
def test_a_rig_plays_experts_at_half_tempo_within_what_the_guard_allows(task: str) -> None:
    """With where the arms would come to rest looked at, too, and what stands fixed."""
    duo = ready_rig(replace(simulated_rig(), cameras={}), guard=True)
    way, layout = half_tempo(task)
    assert duo.guard is not None
    duo.guard.set_scene(catalog.get(task).props, layout)
    for targets in way:
        joints = DuoCommand.from_flat(targets).joints
        duo.command(DuoCommand(joints=joints, openings=np.ones(2)))
        assert duo.held is None


@pytest.mark.parametrize("pace", [0.01, 0.034])  # 1 rad/s, so that the followers are not behind
def test_arms_rest_before_they_meet_and_that_counts_against_who_led(
    guard: Guard, pace: float
) -> None:
    duo, change = ready_rig(guard=True), 0.0
    while not duo.held and change < 1.2:
        change += pace
        duo.command(DuoCommand(joints=leaning(change), openings=np.ones(2)))
    assert duo.fault is not None
    assert duo.fault.kind is FaultKind.CONTACT
    assert duo.fault.text.startswith("The guard refused a command")
    wait(duo, 0.5)
    assert np.abs(speeds(duo)).max() < 1e-3
    assert distance(guard, joints(duo)) > 0.5 * FINGER_MARGIN


def test_a_guard_that_fails_holds_both_arms(monkeypatch: pytest.MonkeyPatch) -> None:
    duo = ready_rig(guard=True)
    duo.command(DuoCommand(joints=HOME_JOINTS, openings=np.ones(2)))

    def fail(*_: Any) -> None:
        raise RuntimeError("no picture")

    monkeypatch.setattr(duo.guard, "problem", fail)
    duo.command(DuoCommand(joints=leaning(0.01), openings=np.ones(2)))
    failed = "The guard failed: RuntimeError('no picture')"
    assert (duo.fault, duo.held) == (FaultKind.CONTROLLER.fault(failed), failed)


def check_free(guard: Guard, start: Array, way: list[Array]) -> None:
    for there in way:
        steps = int(np.ceil(np.abs(there - start).max() / PATH_STEP)) or 1
        for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
            assert guard.problem(start + share * (there - start)) is None
        start = there


def test_the_way_home_is_straight_where_that_is_free(guard: Guard) -> None:
    start = leaning(-0.3)
    way = guard.plan_path(start, HOME_JOINTS)
    assert len(way) == 1
    check_free(guard, start, way)


@pytest.fixture(scope="module")
def crossed(guard: Guard) -> Array:
    """A free configuration from which the straight way home is not free."""
    rng = np.random.default_rng(0)
    while True:
        start = np.clip(HOME_JOINTS + rng.uniform(-0.9, 0.9, (2, 7)), LOWEST, HIGHEST)
        if guard.problem(start) is None:
            shares = np.linspace(0.0, 1.0, 60)[:, None, None]
            if any(guard.problem(p) for p in start + shares * (HOME_JOINTS - start)):
                return start


def test_the_way_home_goes_round_where_the_straight_one_is_not_free(
    guard: Guard, crossed: Array
) -> None:
    way = guard.plan_path(crossed, HOME_JOINTS)
    assert len(way) > 1
    assert np.array_equal(way[-1], HOME_JOINTS)
    check_free(guard, crossed, way)


def test_home_takes_the_way_that_the_guard_found(guard: Guard, crossed: Array) -> None:
    duo = new_rig(guard=True)
    put(duo, crossed)
    confirmed(duo)
    seen = []
    ticker = duo.clock.every(0.1, lambda: seen.append(joints(duo)), "camera")
    duo.home()
    ticker.stop()
    assert duo.supervisor.state is State.READY
    nearest = [guard.nearest(each, MARGIN) for each in seen]
    assert all(found is None or found.room > -0.005 for found in nearest)


def test_arms_without_a_free_way_are_left_to_people(
    crossed: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("duobench.real.guard.path_candidates", lambda _start, end: [[end]])
    duo = new_rig(guard=True)
    put(duo, crossed)
    with pytest.raises(BackendError, match=r"No free way home .* by hand"):
        confirmed(duo).home()
    assert [arm(duo, side).commands for side in SIDES] == [0, 0]


def test_arms_that_are_already_too_near_may_move_apart(guard: Guard) -> None:
    start = next(leaning(c) for c in np.arange(0.0, 1.2, 0.01) if guard.problem(leaning(c)))
    way = guard.plan_path(start, HOME_JOINTS)
    assert np.array_equal(way[-1], HOME_JOINTS)


# --- the cell, and what stands fixed in a layout -------------------------------------------------

CHEST = catalog.get("hinge_chest")


def chest_at(x: float, y: float, z: float) -> Layout:
    """A layout with the chest there, and the cube elsewhere."""
    return Layout(poses={"chest": SE3.at(x, y, z), "cube": SE3.at(0.5, 0.21, 0.2)})


def first_problem(guard: Guard, way: list[Array]) -> str:
    return next((found for joints in way if (found := guard.problem(joints))), "")


def test_hands_keep_away_from_what_stands_fixed_and_fingers_may_touch_it() -> None:
    guard, way = Guard(ROBOT), lowered()
    guard.set_scene(CHEST.props, chest_at(0.51, -0.21, 0.0))
    assert "the table" in first_problem(guard, way)  # fingers are in the chest before
    guard.set_scene(CHEST.props, chest_at(0.51, -0.21, 0.15))
    problem = first_problem(guard, way)
    assert ("the right gripper" in problem, "the chest" in problem) == (True, True)
    assert "at least 10 mm" in problem
    # Under the left hand there is a cube, which is loose.
    guard.set_scene(CHEST.props, chest_at(0.51, -0.6, 0.15))
    assert "the table" in first_problem(guard, way)
    guard.set_scene(catalog.get("bin_sort").props, Layout(poses={}))
    assert "the table" in first_problem(guard, way)


def test_a_lid_is_where_somebody_left_it_and_nothing_to_keep_from() -> None:
    guard = Guard(ROBOT)
    guard.set_scene(CHEST.props, chest_at(0.55, 0.0, 0.0))
    guard.nearest(HOME_JOINTS)
    assert "the chest" in guard._words.values()
    model = guard._sim.model if guard._sim is not None else None
    assert model is not None
    lid = {
        geom
        for geom in range(model.ngeom)
        if model.body(model.geom_bodyid[geom]).name.endswith("lid")
    }
    assert lid
    assert not lid & set(guard._words)


@pytest.mark.slow
def test_an_episode_begins_with_what_its_layout_says_stands_there() -> None:
    duo = new_rig(guard=True)
    env = make_real_env(duo, "hinge_chest", cameras=())

    def led_down(layout: Layout | None) -> str:
        duo.supervisor.confirm()
        env.reset(options={} if layout is None else {"layout": layout})
        for step in lowered():
            env.step(DuoCommand(joints=step, openings=np.ones(2)).flat)
            if duo.fault is not None:
                break
        assert duo.fault is not None
        reason = duo.fault.text
        duo.supervisor.recover()
        duo.supervisor.confirm()
        duo.home()  # before somebody puts the objects elsewhere
        return reason

    assert "the chest" in led_down(chest_at(0.51, -0.21, 0.15))
    assert "the table" in led_down(chest_at(0.51, -0.6, 0.15))
    assert "the chest" in led_down(chest_at(0.51, 0.21, 0.15))
    assert "the table" in led_down(None)
    env.close()


def test_a_tool_is_not_led_out_of_the_workspace_and_finds_back_into_it() -> None:
    box = Workspace(low=(0.1, -0.5, 0.4), high=(0.8, 0.5, 0.8))
    duo = ready_rig(replace(simulated_rig(), cameras={}, workspace=box), guard=True)
    assert duo.guard is not None
    for joints_of_step in lowered():
        duo.command(DuoCommand(joints=joints_of_step, openings=np.ones(2)))
        if duo.held:
            break
    assert duo.fault is not None
    assert duo.fault.kind is FaultKind.CONTACT
    assert "tool would be" in duo.fault.text
    assert "outside of the workspace" in duo.fault.text
    wait(duo, 0.5)
    assert ROBOT.tcp_poses(joints(duo))[:, 2].min() > 0.395
    outside = lowered()[40]
    assert duo.guard.problem(outside) is not None
    assert ROBOT.tcp_poses(outside)[:, 2].max() < 0.38
    way = duo.guard.plan_path(outside, HOME_JOINTS)
    assert np.array_equal(way[-1], HOME_JOINTS)
    assert not duo.guard.is_free(outside, [lowered()[50]])  # further out


def test_a_path_that_begins_outside_of_the_workspace_is_not_free_of_anything_else() -> None:
    guard = Guard(ROBOT, Workspace(low=(0.1, -0.5, 0.4), high=(0.8, 0.5, 0.8)))
    outside = lowered()[40]
    meeting = next(c for c in np.arange(0.0, 1.2, 0.02) if guard.problem(leaning(c)))
    assert not guard.is_free(outside, [leaning(meeting + 0.1)])


def test_a_lab_has_obstacles_of_its_own() -> None:
    mast = Obstacle(centre=(0.51, 0.21, 0.1), size=(0.1, 0.1, 0.1), yaw=0.3)
    guard = Guard(ROBOT, obstacles={"mast": mast})
    problem = first_problem(guard, lowered())
    assert ("left" in problem, "the obstacle mast" in problem) == (True, True)
    assert "at least 20 mm" in problem  # fingers, too
    guard.set_scene(CHEST.props, chest_at(0.51, -0.21, 0.25))
    assert "the chest" in first_problem(guard, lowered())
    guard.set_scene((), Layout(poses={}))
    assert "the obstacle mast" in first_problem(guard, lowered())


def test_experts_and_home_are_well_within_the_workspace_of_a_new_rig() -> None:
    box = Workspace()
    assert min(box.room(tool[:3]) for tool in ROBOT.tcp_poses(HOME_JOINTS)) > 0.2
