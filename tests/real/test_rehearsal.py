"""The rehearsal: our own simulation behind the protocols of arms, grippers and cameras."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from duobench.core.backend import DEPTH, RGB
from duobench.core.errors import BackendError, UnknownNameError
from duobench.core.spatial import SE3
from duobench.core.types import SIDES, DuoCommand, Side
from duobench.real.clock import PacedClock, VirtualClock
from duobench.real.duo import FrankaDuo
from duobench.real.env import make_real_env
from duobench.real.opening import REHEARSAL_SIZE, open_rig, rehearsal_rig
from duobench.real.rehearsal import HAND_M, HAND_RAD, MAX_BEHIND_S, STEP_S, RehearsalWorld
from duobench.real.rig import JOINT_TORQUES
from duobench.real.supervisor import State
from duobench.results.labels import FaultKind
from duobench.tasks import catalog
from duobench.world.robot.cameras import HEAD, POLICY_CAMERAS
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.mounts import HOME_JOINTS
from duobench.world.sim import rendering_process
from duobench.world.sim.backend import SimBackend
from duobench.world.sim.rendering import Renderer
from tests.quick_first import quick_first
from tests.real.rigs import home, new_rig, quick_rig, refused, wait

TASK = catalog.get("transfer_cube")
LAYOUT = next(TASK.layouts(1))
CUBE = "cube"


@contextmanager
def rehearsal(*, cameras: bool = False, **changes: Any) -> Iterator[FrankaDuo]:
    """A rehearsal that is started; changes are fields of its arms."""
    with closing(new_rig(quick_rig(cameras=cameras, **changes))) as duo:
        duo.start()
        yield duo


@pytest.fixture
def duo() -> Iterator[FrankaDuo]:
    """A rehearsal whose grippers are active."""
    with rehearsal() as made:
        made.hands.activate()
        yield made


def world_of(duo: FrankaDuo) -> RehearsalWorld:
    assert duo.world is not None
    return duo.world


def give(duo: FrankaDuo, side: Side) -> None:
    """Hold the cube between the fingers of a hand until they have it."""
    world, name = world_of(duo), next(iter(world_of(duo).simulation.props))
    duo.grippers[side].command(0.0)
    for _ in range(60):
        with world.lock:
            tool = world.simulation.site_pose(f"{side}/tcp")
            world.simulation.place(name, SE3(np.eye(3), tool.translation))
        wait(duo, 1 / 30)
        if duo.grippers[side].read().has_object:
            return
    raise AssertionError("The hand did not get it.")


# --- grippers ------------------------------------------------------------------------------------


def test_in_the_morning_no_gripper_moves_before_it_is_activated() -> None:
    with rehearsal() as duo:
        assert not any(each.is_active for each in duo.gripper_readings().values())
        duo.grippers[Side.LEFT].command(0.0)
        wait(duo, 1.0)
        assert duo.gripper_readings()[Side.LEFT].opening > 0.99
        duo.supervisor.confirm()
        assert "not active" in refused(duo.home)
        narrowest = [1.0, 1.0]

        def watch() -> None:
            for side, reading in duo.gripper_readings().items():
                narrowest[side.index] = min(narrowest[side.index], reading.opening)

        duo.clock.every(0.05, watch, "watch")
        duo.hands.activate()
        assert max(narrowest) < 0.05, "it goes through its whole range"
        assert all(each.is_active for each in duo.gripper_readings().values())
        home(duo)


def test_fingers_feel_what_they_hold_and_let_it_drop(duo: FrankaDuo) -> None:
    duo.place(TASK, LAYOUT)
    duo.grippers[Side.LEFT].command(0.0)
    wait(duo, 1.5)
    assert not duo.gripper_readings()[Side.LEFT].has_object
    duo.grippers[Side.LEFT].command(1.0)
    wait(duo, 1.5)
    give(duo, Side.LEFT)
    wait(duo, 1.0)
    reading = duo.gripper_readings()[Side.LEFT]
    assert reading.has_object
    assert 0.1 < reading.opening < 0.9
    assert duo.hands.holding == (Side.LEFT,)
    assert "left gripper holds something" in refused(lambda: duo.place(TASK, LAYOUT))
    duo.hands.open()
    wait(duo, 1.0)
    world = world_of(duo)
    with world.lock:
        simulation = world.simulation
        assert simulation.min_height(next(iter(simulation.props))) < 0.005, "it dropped"
    assert not duo.gripper_readings()[Side.LEFT].has_object


def test_lost_power_keeps_the_grip_and_is_a_fault_until_a_person_has_seen_to_it(
    duo: FrankaDuo,
) -> None:
    duo.place(TASK, LAYOUT)
    give(duo, Side.RIGHT)
    gripper = world_of(duo).grippers[Side.RIGHT]
    before = gripper.position
    gripper.lose_power()
    wait(duo, 0.5)
    assert duo.fault is not None
    assert duo.fault.kind is FaultKind.COMMUNICATION
    assert "has not answered" in duo.fault.text
    assert gripper.position == pytest.approx(before, abs=1.0)
    gripper.has_power = True
    wait(duo, 0.2)
    assert not duo.gripper_readings()[Side.RIGHT].is_active
    duo.supervisor.recover()
    assert duo.hands.inactive == (Side.RIGHT,)
    duo.hands.activate()
    assert duo.hands.inactive == ()


# --- arms ----------------------------------------------------------------------------------------


def push_down(duo: FrankaDuo, side: Side) -> int:
    """Lead an arm from home into the table until the arms are held; after how many commands."""
    home(duo)
    joints = HOME_JOINTS.copy()
    count = 0
    while duo.held is None:
        joints[side.index, 1] += 0.01
        duo.command(DuoCommand(joints=joints, openings=np.ones(2)))
        count += 1
        assert count < 200
    return count


@pytest.mark.parametrize("side", quick_first(SIDES))
def test_an_arm_that_runs_into_the_table_stops_by_a_reflex_and_goes_home(
    side: Side, duo: FrankaDuo
) -> None:
    push_down(duo, side)
    assert duo.fault is not None
    assert duo.fault.kind is FaultKind.CONTACT
    assert f"{side} arm" in duo.fault.text
    assert "reflex" in duo.fault.text
    reading = duo.readings()[side]
    assert not reading.is_tracking
    wait(duo, 1.0)
    assert np.abs(duo.readings()[side].joints - reading.joints).max() < 0.02, "it stays"
    duo.supervisor.recover()
    home(duo)
    assert duo.supervisor.state is State.READY


@pytest.mark.slow
def test_thresholds_are_those_of_the_rig() -> None:
    counts = []
    for threshold in (20.0, 80.0):
        with rehearsal(force_threshold=threshold, torque_threshold=JOINT_TORQUES) as duo:
            duo.hands.activate()
            counts.append(push_down(duo, Side.LEFT))
            assert duo.fault is not None
            assert duo.fault.kind is FaultKind.CONTACT
    assert counts[0] < counts[1], "it presses harder before it stops"


def test_a_person_stops_the_arms_until_the_button_is_released(duo: FrankaDuo) -> None:
    world = world_of(duo)
    home(duo)
    world.press_stop()
    duo.command(duo.last_command)
    assert duo.fault is not None
    assert duo.fault.kind is FaultKind.PERSON
    assert "Release it" in refused(duo.supervisor.recover)
    world.release_stop()
    duo.supervisor.recover()
    assert duo.fault is None


def test_swapped_arms_are_told_by_gravity() -> None:
    rig = rehearsal_rig()
    swapped = {side: replace(rig.arms[side], address=side.other) for side in SIDES}
    duo = new_rig(replace(rig, arms=swapped, cameras={}))
    with closing(duo), pytest.raises(BackendError, match="swapped"):
        duo.start()


def test_an_address_is_a_mount() -> None:
    rig = rehearsal_rig()
    arms = {side: replace(arm, address="middle") for side, arm in rig.arms.items()}
    with pytest.raises(UnknownNameError, match="left"):
        open_rig(replace(rig, arms=arms), VirtualClock())


def test_arms_stay_near_what_they_are_told(duo: FrankaDuo) -> None:
    home(duo)
    off = 0.0
    for step in range(90):
        joints = HOME_JOINTS + 0.1 * math.sin(step / 15) * np.ones((2, 7))
        duo.command(DuoCommand(joints=joints, openings=np.ones(2)))
        off = max(off, float(np.abs(duo.read().joints - joints).max()))
    assert duo.fault is None
    assert off < 0.05


# --- the world -----------------------------------------------------------------------------------


def placed(seed: int, task: str = "bin_sort") -> dict[str, SE3]:
    """How far each object lies from where it should, in the frame of where it should."""
    definition = catalog.get(task)
    layout = next(definition.layouts(seed))
    with rehearsal() as duo:
        duo.place(definition, layout)
        simulation = world_of(duo).simulation
        return {
            name: layout.poses[name].inverse() @ simulation.pose(name) for name in simulation.props
        }


@pytest.mark.parametrize("task", ["bin_sort", "hinge_chest", "ball_maze"])
def test_objects_are_placed_with_the_errors_of_a_hand(task: str) -> None:
    errors, again = placed(3, task), placed(3, task)
    for name, error in errors.items():
        assert np.array_equal(error.translation, again[name].translation)
        assert np.abs(error.translation[:2]).max() < 6.0 * HAND_M
    assert any(np.abs(each.translation[:2]).max() > 0.1 * HAND_M for each in errors.values())
    flat = [abs(each.yaw) for name, each in errors.items() if "ball" not in name]
    assert 0.01 * HAND_RAD < max(flat) < 6.0 * HAND_RAD


@pytest.mark.parametrize("task", catalog.names())
def test_every_task_lies_still_where_it_was_placed(task: str, duo: FrankaDuo) -> None:
    definition = catalog.get(task)
    for seed in range(3):
        layout = next(definition.layouts(seed))
        duo.place(definition, layout)
        assert duo.fault is None
        simulation = world_of(duo).simulation
        assert dict(simulation.variants) == dict(layout.variants)
        for name in simulation.props:
            off = simulation.position(name) - layout.poses[name].translation
            assert np.abs(off).max() < 0.02, name
            assert math.hypot(*simulation.velocity(name)) < 0.05, name


def test_objects_are_placed_as_new(duo: FrankaDuo) -> None:
    task = catalog.get("hinge_chest")
    layout = next(task.layouts(1))
    duo.place(task, layout)
    world = world_of(duo)
    model = world.simulation.model
    hinges = [
        int(model.joint(number).qposadr[0])
        for number in range(model.njnt)
        if model.joint(number).name.startswith("chest")
    ]
    before = world.simulation.data.qpos[hinges].copy()
    with world.lock:
        world.simulation.data.qpos[hinges] += 0.5
    joints = duo.readings()[Side.LEFT].joints
    duo.place(task, layout)
    assert hinges
    assert np.abs(world.simulation.data.qpos[hinges] - before).max() < 0.1
    assert np.abs(duo.readings()[Side.LEFT].joints - joints).max() < 0.01, "arms stay"


def test_an_arm_in_the_way_is_told_and_nothing_changes(duo: FrankaDuo) -> None:
    duo.place(TASK, LAYOUT)
    world = world_of(duo)
    name = next(iter(world.simulation.props))
    before = world.simulation.pose(name)
    inside = SE3(np.eye(3), world.simulation.position("right/link6"))
    assert "right arm is where" in refused(
        lambda: duo.place(TASK, replace(LAYOUT, poses={**LAYOUT.poses, name: inside}))
    )
    assert np.allclose(world.simulation.pose(name).translation, before.translation, atol=1e-6)
    wait(duo, 0.1)
    assert duo.fault is None


def test_another_task_takes_the_place_of_the_objects(duo: FrankaDuo) -> None:
    for name in ("bin_sort", "hinge_chest", "bin_sort"):
        task = catalog.get(name)
        duo.place(task, next(task.layouts(1)))
        assert set(world_of(duo).simulation.props) == {prop.name for prop in task.props}
        wait(duo, 0.5)
        assert duo.fault is None
        assert np.abs(duo.read().joints - HOME_JOINTS).max() < 0.02


@pytest.mark.slow
def test_the_same_commands_do_the_same() -> None:
    seen = []
    for _ in range(2):
        with rehearsal() as duo:
            duo.hands.activate()
            duo.place(TASK, LAYOUT)
            push_down(duo, Side.LEFT)
            seen.append((duo.clock.now(), world_of(duo).simulation.get_state()))
    assert seen[0][0] == seen[1][0]
    assert np.array_equal(seen[0][1], seen[1][1])


class Late(VirtualClock):
    """A clock whose time leaps, as that of a computer that stood still."""

    def leap(self, seconds: float) -> None:
        self._now += seconds


def test_a_late_world_goes_on_more_slowly_and_does_not_leap() -> None:
    clock = Late()
    world = RehearsalWorld(clock, ROBOT)
    world.enter(world)
    clock.wait_until(0.1)
    before = world._steps
    clock.leap(1.0)
    clock.wait_until(clock.now() + STEP_S)
    assert world._steps - before <= MAX_BEHIND_S / STEP_S + 2


def test_physics_that_fails_is_a_fault_of_ours(duo: FrankaDuo) -> None:
    duo.place(TASK, LAYOUT)
    world = world_of(duo)
    with world.lock:
        world.simulation.data.qvel[:] = math.nan
    wait(duo, 0.1)
    assert duo.fault is not None
    assert duo.fault.kind is FaultKind.CONTROLLER
    assert np.isfinite(duo.read().joints).all()
    duo.place(TASK, LAYOUT)
    duo.supervisor.recover()
    wait(duo, 0.5)
    assert duo.fault is None


# --- cameras -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_cameras_see_the_world_from_a_process_of_their_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with rehearsal(cameras=True) as duo:
        duo.place(TASK, LAYOUT)
        wait(duo, 0.2)
        scene = world_of(duo).simulation
        height, width = REHEARSAL_SIZE
        with Renderer(scene.model, height=height, width=width) as renderer:
            wanted = renderer.render(scene.data, HEAD)
        frames = duo.frames()
        assert set(frames) == set(POLICY_CAMERAS)
        assert frames[HEAD].image.shape == (*REHEARSAL_SIZE, 3)
        off = np.abs(frames[HEAD].image.astype(int) - wanted.astype(int))
        assert off.mean() < 0.5, "objects rest, so that the image is that of this moment"
        assert max(duo.image_ages().values()) < 0.05
        rendering_process.current().end()
        wait(duo, 0.5)
        assert duo.fault is None, "a new process renders"
        monkeypatch.setenv("MUJOCO_GL", "off")
        rendering_process.current().end()
        wait(duo, 1.0)
        assert duo.fault is not None
        assert "cannot be rendered: Rendering is switched off by MUJOCO_GL=off" in duo.fault.text


def test_wrists_measure_depth_and_the_head_does_not() -> None:
    """It is the simulation's, where the images are, and a policy sees it through the same door."""
    with rehearsal(cameras=True) as duo:
        duo.hands.activate()
        duo.place(TASK, LAYOUT)
        wait(duo, 0.2)
        wanted: Any = {DEPTH: {"left_wrist": REHEARSAL_SIZE}, RGB: {"head": (48, 64)}}
        seen = duo.images_by_kind(wanted)
        scene = world_of(duo).simulation
        expected = SimBackend(scene)
        exact = expected.images_by_kind(wanted)[DEPTH]["left_wrist"]
        assert np.abs(seen[DEPTH]["left_wrist"] - exact).mean() < 2e-4
        sizes: Any = dict.fromkeys(POLICY_CAMERAS, (48, 64))
        for name, placed in expected.camera_geometry(sizes).items():
            found = duo.camera_geometry(sizes)[name]
            np.testing.assert_allclose(found.matrix, placed.matrix)
            np.testing.assert_allclose(found.table_from_camera, placed.table_from_camera, atol=2e-3)
        expected.close()
        env = make_real_env(duo, TASK, depth=("left_wrist", "right_wrist"), image_size=32)
        duo.supervisor.confirm()
        observation, _ = env.reset()
        assert env.observation_space.contains(observation)
        assert observation["depth"]["right_wrist"].min() > 0.02
        with pytest.raises(BackendError, match=r"camera head .* no depth; left_wrist, right_wrist"):
            make_real_env(duo, TASK, depth=True)


# --- time for people -----------------------------------------------------------------------------


def test_time_passes_no_faster_than_real_and_in_order() -> None:
    clock, calls = PacedClock(), list[tuple[str, float]]()
    began = time.monotonic()
    tickers = [
        clock.every(period, lambda name=name: calls.append((name, clock.now())), name)
        for name, period in (("a", 0.01), ("b", 0.025))
    ]
    clock.wait_until(0.2)
    assert clock.now() <= time.monotonic() - began
    for ticker in tickers:
        ticker.stop()
        ticker.stop()
    count = len(calls)
    clock.wait_until(clock.now() + 0.05)
    assert len(calls) == count
    times = [when for _, when in calls]
    assert times == sorted(times)
    early = [name for name, when in calls if when < 0.0999]
    assert (early.count("a"), early.count("b")) == (9, 3), "none is left out"


@pytest.mark.slow
def test_a_call_that_takes_long_slows_time_down_for_everybody() -> None:
    rig = rehearsal_rig()
    with closing(open_rig(replace(rig, cameras={}), guard=False)) as duo:
        assert isinstance(duo.clock, PacedClock)
        duo.start()
        duo.hands.activate()
        home(duo)
        held = duo.clock.every(0.1, lambda: time.sleep(0.4), "a computer that stands still")
        for _ in range(10):
            duo.command(duo.last_command)
        held.stop()
        assert duo.held is None
        assert duo.fault is None


def test_whoever_waits_is_told_of_an_error() -> None:
    clock = PacedClock()

    def fail() -> None:
        raise BackendError("It broke.")

    clock.every(0.01, fail, "broken")
    for _ in range(2):
        assert "It broke" in refused(lambda: clock.wait_until(clock.now() + 10.0))
