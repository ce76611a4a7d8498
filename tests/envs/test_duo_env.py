"""The base environment: what it takes, what it gives, what it refuses."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from duobench.core.errors import ActionError, DuoBenchError, LayoutError, SimulationError
from duobench.core.randomness import Choice
from duobench.core.spatial import SE3
from duobench.core.types import ARM_JOINTS, CONTROL_HZ, SIDE_SIZE, SIDES
from duobench.envs.duo_env import ResetNeededError
from duobench.envs.sim_env import SimEnv
from duobench.envs.spaces import REACH
from duobench.tasks import catalog
from duobench.tasks.task import Task
from duobench.world.objects.prop import Prop, Variant
from duobench.world.objects.shapes import box
from duobench.world.objects.solid import Solid
from duobench.world.robot.joints import JOINT_RANGES, VELOCITY_LIMITS
from duobench.world.robot.mounts import HOME_JOINTS
from duobench.world.scene.naming import tcp_name
from duobench.world.sim.layout import Layout
from tests.envs.tools import TASK, equal, wave, waves

OPENINGS = [7, 15]
BLOCKED, MOST_BLOCKED = 0.02, 6
"""A target that leads its joint by more than that is of one that something blocks; so many are."""


@pytest.fixture(scope="module")
def env() -> Iterator[SimEnv]:
    env = SimEnv(catalog.get(TASK))
    yield env
    env.close()


@pytest.fixture
def running(env: SimEnv) -> SimEnv:
    env.reset(seed=0)
    return env


def test_the_action_space_is_the_arms_own(env: SimEnv) -> None:
    space = env.action_space
    assert (space.shape, space.dtype) == ((16,), np.float32)
    ranges = np.tile(np.vstack([JOINT_RANGES, (0.0, 1.0)]), (2, 1)).T
    assert np.array([space.low, space.high]) == pytest.approx(ranges, abs=1e-6)
    assert [space.low[OPENINGS].tolist(), space.high[OPENINGS].tolist()] == [[0.0] * 2, [1.0] * 2]


@pytest.mark.parametrize("corner", ["low", "high"])
def test_every_corner_of_the_action_space_can_be_commanded(running: SimEnv, corner: str) -> None:
    action = getattr(running.action_space, corner)
    farthest = np.abs(action[:ARM_JOINTS] - HOME_JOINTS[0]).max()
    for _ in range(math.ceil(farthest / min(VELOCITY_LIMITS) * CONTROL_HZ) + 1):
        *_, info = running.step(action)
    # Arms that meet each other or the table stay on the way, and so do their targets.
    sent = running.simulation.duo.command().flat
    behind = np.abs(sent - running.simulation.duo.read().flat)
    assert (behind[info["clipped"]] > BLOCKED).all()
    assert np.count_nonzero(info["clipped"]) < MOST_BLOCKED
    there = ~info["clipped"]
    assert sent[there] == pytest.approx(action[there], abs=1e-6)


def test_an_observation_is_what_the_robot_reports(env: SimEnv) -> None:
    observation, info = env.reset(seed=0)
    assert observation in env.observation_space
    assert list(observation) == ["agent_pos", "tcp_pose"]
    state = env.simulation.duo.read()
    assert np.array_equal(observation["agent_pos"], state.flat.astype(np.float32))
    assert np.array_equal(observation["tcp_pose"], state.tcp_poses.ravel().astype(np.float32))
    assert observation["agent_pos"].reshape(2, 8)[:, :7] == pytest.approx(HOME_JOINTS, abs=1e-3)
    assert observation["agent_pos"][OPENINGS] == pytest.approx([1.0, 1.0], abs=0.01)
    assert not info["clipped"].any()


def test_the_base_has_no_reward_and_no_end(running: SimEnv) -> None:
    assert [running.step(action)[1:4] for action in waves(3)] == [(0.0, False, False)] * 3


def test_without_a_layout_every_reset_is_the_same(env: SimEnv) -> None:
    state_hashes = set()
    for seed in (0, 1, None):
        env.reset(seed=seed)
        state_hashes.add(env.state_hash())
    assert len(state_hashes) == 1


def test_targets_out_of_range_are_clipped_and_reported(running: SimEnv) -> None:
    action = wave(0).astype(np.float64)
    action[[6, 7]] = [9.0, -0.5]
    for _ in range(60):
        *_, info = running.step(action)
        assert np.flatnonzero(info["clipped"]).tolist() == [6, 7]
        assert running.requested.tolist() == action.tolist()
    ends = [JOINT_RANGES[6, 1], 0.0]
    assert running.simulation.duo.command().flat[[6, 7]].tolist() == ends
    action[[6, 7]] = ends
    assert not running.step(action)[4]["clipped"].any()


@pytest.mark.parametrize("joint", range(ARM_JOINTS))
def test_targets_move_no_faster_than_the_joints(running: SimEnv, joint: int) -> None:
    limit = VELOCITY_LIMITS[joint] / CONTROL_HZ
    start = running.simulation.duo.command().flat
    for side in SIDES:
        slot, away = side.index * SIDE_SIZE + joint, -np.sign(start[joint + side.index * SIDE_SIZE])
        for share, clipped in ((1.0, []), (1.5, [slot])):
            before = running.simulation.duo.command().flat
            action = before.copy()
            action[slot] += away * share * limit
            *_, info = running.step(action)
            assert np.flatnonzero(info["clipped"]).tolist() == clipped
            moved = running.simulation.duo.command().flat - before
            assert moved[slot] == pytest.approx(away * limit)


def test_openings_are_never_clipped_for_speed(running: SimEnv) -> None:
    action = running.simulation.duo.command().flat
    for opening in (0.0, 1.0):
        action[OPENINGS] = opening
        *_, info = running.step(action)
        assert not info["clipped"].any()
        assert running.simulation.duo.command().openings == pytest.approx([opening] * 2)


NO_NUMBERS = "array of numbers"
BAD_ACTIONS: dict[str, tuple[Any, str]] = {
    "nan": (np.where(np.arange(16) == 3, np.nan, 0.0), "left_joint_4 is nan"),
    "infinite": (np.where(np.arange(16) == 15, -np.inf, 0.0), "right_gripper is -inf"),
    "opposite infinities": (np.array([np.inf, -np.inf, *np.zeros(14)]), "left_joint_2 is -inf"),
    "short": (np.zeros(14), r"\(16,\).*left_joint_1.*\(14,\)"),
    "long": (np.zeros(17), "shape"),
    "matrix": (np.zeros((1, 16)), "shape"),
    "scalar": (0.0, "shape"),
    "text": ("left", f"{NO_NUMBERS}.*'left'"),
    "ragged": ([[0.0], [0.0, 1.0]], NO_NUMBERS),
    "nothing": (None, "shape"),
    "complex": (np.zeros(16, dtype=complex), NO_NUMBERS),
    "digits": (["0"] * 16, NO_NUMBERS),
    "times": (np.zeros(16, dtype="timedelta64[s]"), NO_NUMBERS),
    "masked": (np.ma.masked_equal(np.zeros(16), 0.0), NO_NUMBERS),
}


@pytest.mark.parametrize(("bad", "words"), BAD_ACTIONS.values(), ids=BAD_ACTIONS)
def test_a_bad_action_changes_nothing(running: SimEnv, bad: Any, words: str) -> None:
    running.step(wave(1))
    before = running.state_hash()
    with pytest.raises(ActionError, match=words):
        running.step(bad)
    assert running.state_hash() == before
    after_bad = running.step(wave(2))
    running.reset(seed=0)
    running.step(wave(1))
    assert equal(after_bad[0], running.step(wave(2))[0])


def test_huge_but_finite_targets_are_clipped(running: SimEnv) -> None:
    assert running.step(np.full(16, 1.5e308))[4]["clipped"].all()


def test_lists_and_float64_are_actions_too(running: SimEnv) -> None:
    one = running.step(wave(3).tolist())[0]
    running.reset(seed=0)
    assert equal(one, running.step(wave(3).astype(np.float64))[0])


def test_a_step_before_the_first_reset_is_refused() -> None:
    fresh = SimEnv(catalog.get(TASK), render_mode="rgb_array")
    for early, words in (
        (lambda: fresh.step(wave(0)), "call reset"),
        (lambda: fresh.layout, "call reset"),
        (fresh.render, "before the first reset"),
    ):
        with pytest.raises(ResetNeededError, match=words) as refused:
            early()
        assert isinstance(refused.value, gym.error.ResetNeeded)


def test_diverged_physics_ends_the_episode(running: SimEnv) -> None:
    running.simulation.data.qvel[:] = 1e30
    with pytest.raises(SimulationError, match=r"bad.*reset the environment"):
        running.step(wave(0))
    with pytest.raises(ResetNeededError):
        running.step(wave(0))
    running.reset(seed=0)
    assert running.step(wave(0))[0] in running.observation_space


def test_a_hold_ends_the_episode_and_the_next_beginning_ends_the_hold(running: SimEnv) -> None:
    saved = running.save_state()
    for begin_again in (lambda: running.restore_state(saved), running.reset):
        running.step(wave(1))
        before = running.state_hash()
        running.backend.hold("Somebody came too near.")
        *_, truncated, info = running.step(wave(2))
        assert (truncated, info["truncation_reason"]) == (True, "Somebody came too near.")
        assert running.state_hash() == before, "nothing moves any more"
        begin_again()
    *_, truncated, info = running.step(wave(1))
    assert (truncated, "truncation_reason" in info) == (False, False)


@pytest.fixture
def worlds() -> Task:
    """A task with two variants that differ in the compiled model: with and without a tower."""
    tower = Solid(
        shapes=(box(0.1, 0.1, 0.02), box(0.02, 0.02, 0.2, at=SE3.at(z=0.1))),
        rgba=(1.0, 1.0, 1.0, 1.0),
    )
    prop = Prop(
        name="tower",
        solid=tower,
        choice="world",
        variants={"high": Variant(), "flat": Variant(without_shapes=frozenset({1}))},
    )
    task = catalog.get(TASK)
    return replace(
        task,
        instruction="Sort in a {world} world.",
        props=(*task.props, prop),
        variants={"world": Choice(("high", "flat"))},
    )


def world(name: str) -> Layout:
    sampled = next(catalog.get(TASK).layouts(5))
    poses = {**sampled.poses, "tower": SE3.at(0.8, 0.0, 0.01)}
    return Layout(poses=poses, variants={"world": name})


def test_a_layouts_variant_is_switched_in_the_model(worlds: Task) -> None:
    env = SimEnv(worlds)
    assert env.task_description == "Sort in a {world} world."
    hashes: dict[str, set[str]] = {"high": set(), "flat": set()}
    for name in ("high", "flat", "high", "high", "flat"):
        _, info = env.reset(options={"layout": world(name)})
        assert info["instruction"] == env.task_description == f"Sort in a {name} world."
        assert info["layout"]["variants"] == {"world": name}
        geom = env.simulation.model.geom("tower:1")
        assert (geom.contype[0] > 0) == (geom.conaffinity[0] > 0) == (name == "high")
        hashes[name].add(env.save_state().hash)
    assert [len(found) for found in hashes.values()] == [1, 1]
    assert hashes["high"] != hashes["flat"]


@pytest.mark.parametrize("variants", [{}, {"world": "round"}])
def test_an_unknown_variant_is_refused(worlds: Task, variants: dict[str, str]) -> None:
    env = SimEnv(worlds)
    with pytest.raises(LayoutError, match="variant 'world', one of high, flat"):
        env.reset(options={"layout": {**world("flat").to_json(), "variants": variants}})


def test_a_variant_that_only_the_instruction_names_must_be_given(worlds: Task) -> None:
    env = SimEnv(replace(worlds, instruction="Go from {here}.", variants={}))
    with pytest.raises(LayoutError, match="'here'"):
        env.reset(options={"layout": world("flat")})


def test_two_environments_share_nothing_that_changes() -> None:
    one, other = SimEnv(catalog.get(TASK)), SimEnv(catalog.get(TASK))
    one.reset(seed=0)
    other.reset(seed=0)
    before = other.state_hash()
    for action in waves(5):
        one.step(action)
    one.simulation.model.geom_friction[:] = 0.0
    assert other.state_hash() == before
    assert other.simulation.model.geom_friction.any()


def test_render_draws_the_overview(running: SimEnv) -> None:
    with pytest.raises(DuoBenchError, match="render_mode"):
        running.render()
    env = SimEnv(catalog.get(TASK), render_mode="rgb_array", render_size=(48, 64))
    env.reset(seed=0)
    image = env.render()
    assert (image.shape, image.dtype) == ((48, 64, 3), np.uint8)
    assert image.std() > 10
    env.close()
    env.close()


def test_no_chain_of_links_leaves_the_space_of_tool_poses() -> None:
    """Stretched out in any direction, whatever the joints' ranges are."""
    model = SimEnv(catalog.get(TASK)).simulation.model
    for side in SIDES:
        site = model.site(tcp_name(side))
        length, body = float(np.linalg.norm(site.pos)), model.body(int(site.bodyid[0]))
        while body.parentid[0] != 0:
            length += float(np.linalg.norm(body.pos))
            body = model.body(int(body.parentid[0]))
        assert (np.abs(body.pos) + length).max() < REACH
        assert 1.1 * (np.abs(body.pos) + length).max() > REACH, "the space says something"
