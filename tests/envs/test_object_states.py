"""Object states: the numbers are those of the simulation, of what the layout chose, and named."""

import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from duobench.core.randomness import Uniform
from duobench.envs import sim_of
from duobench.tasks import catalog
from duobench.world.objects import cup
from duobench.world.objects.maze_board import cell_centre
from duobench.world.objects.mazes import CELLS, MAZES, Direction, Segment
from duobench.world.sim.simulation import Simulation
from tests.envs.tools import Make, equal, waves

SPEED, OPENED = 0.5, 0.7
"""What objects are kicked with, in m/s and rad/s, and how far hinges are opened, in radians."""
MOVED, ROUNDING = 1e-3, 1e-6


def named(env: Any, observation: Mapping[str, np.ndarray]) -> dict[str, float]:
    names = env.get_wrapper_attr("object_state_names")
    assert len(set(names)) == len(names)
    return dict(zip(names, observation["environment_state"].tolist(), strict=True))


def measured(simulation: Simulation, name: str) -> float | None:
    """What the engine says of the number of a name; None for what the layout chose, and marbles."""
    data = simulation.data
    if found := re.fullmatch(r"(.+)_angle", name):
        return float(data.joint(found[1]).qpos[0])
    if found := re.fullmatch(r"(.+)_velocity_([xyz])", name):
        return float(data.body(found[1]).cvel[3:]["xyz".index(found[2])])
    if found := re.fullmatch(r"(.+)_([xyz])_axis_([xyz])", name):
        row, column = ("xyz".index(axis) for axis in (found[3], found[2]))
        return float(data.body(found[1]).xmat.reshape(3, 3)[row, column])
    found = re.fullmatch(r"(.+)_([xyz])", name)
    if found is None or found[1] == "marbles":
        return None
    return float(data.body(found[1]).xpos["xyz".index(found[2])])


def check(env: Any, observation: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Compare an observation with the engine."""
    found = named(env, observation)
    assert observation["environment_state"] in env.observation_space["environment_state"]
    simulation = sim_of(env).simulation
    expected = {name: measured(simulation, name) for name in found}
    compared = {name: value for name, value in expected.items() if value is not None}
    assert compared
    assert {name: found[name] for name in compared} == pytest.approx(compared, abs=ROUNDING)
    return found


@pytest.mark.parametrize("task", catalog.names())
def test_numbers_are_those_of_the_simulation(make: Make, task: str) -> None:
    env = make(task, object_state=True)
    observation, _ = env.reset(seed=0)
    first, state = check(env, observation), env.save_state()
    data = sim_of(env).simulation.data
    data.qvel[:] += SPEED
    for name in (name.removesuffix("_angle") for name in first if name.endswith("_angle")):
        data.joint(name).qpos[0] = OPENED
    later = check(env, env.step(waves(1)[0])[0])
    moved = {name for name, value in later.items() if abs(value - first[name]) > MOVED}
    free = [prop.name for prop in catalog.get(task).props if not prop.fixed]
    moving = {f"{name}_x" for name in free} | {"ball_velocity_y", "marbles_y"}
    moving |= {name for name in first if name.endswith("_angle")}
    assert moving & first.keys() <= moved
    other, _ = env.reset(seed=1)
    assert check(env, other) != first
    restored, _ = env.restore_state(state)
    assert equal(restored, observation)


def test_the_full_cup_is_the_one_with_the_marbles(make: Make) -> None:
    env = make("pour_marbles", object_state=True)
    seen = set()
    for seed in range(8):
        observation, info = env.reset(seed=seed)
        found, full = named(env, observation), info["layout"]["variants"]["full"]
        seen.add(full)
        for side in ("left", "right"):
            said = found[f"full_is_{side}"], found[f"marbles_in_{side}_cup"]
            assert said == (side == full,) * 2
        middle = [found[f"marbles_{axis}"] - found[f"{full}_cup_{axis}"] for axis in "xyz"]
        assert np.hypot(*middle[:2]) < cup.MARBLE_RADIUS
        assert 0 < found["marbles_spread"] < cup.INNER_RADIUS
    assert seen == {"left", "right"}


def test_walls_start_and_goal_are_those_of_the_board(make: Make) -> None:
    env = make("ball_maze", object_state=True)
    boards = set()
    for seed in range(12):
        observation, info = env.reset(seed=seed)
        found, board = named(env, observation), info["layout"]["variants"]["board"]
        boards.add(board)
        maze = MAZES[int(board)]
        for place, cell in (("start", maze.start), ("goal", maze.goal)):
            assert (found[f"{place}_column"], found[f"{place}_row"]) == cell
        walls = {
            f"wall_{direction.name.lower()}_of_{i}_{j}": Segment.beyond((i, j), direction)
            for direction in (Direction.EAST, Direction.NORTH)
            for i, j in product(range(CELLS), repeat=2)
            if max(direction.next((i, j))) < CELLS
        }
        assert {name: wall in maze.walls for name, wall in walls.items()} == {
            name: value for name, value in found.items() if name.startswith("wall")
        }
        x, z = (
            np.array([found[f"board_{column}_axis_{axis}"] for axis in "xyz"]) for column in "xz"
        )
        offset = np.array([found[f"ball_{axis}"] - found[f"board_{axis}"] for axis in "xyz"])
        at = (offset @ x, offset @ np.cross(z, x))
        assert at == pytest.approx(cell_centre(maze.start), abs=1e-3)
    assert len(boards) > 5


def test_one_vector_holds_everything_in_the_order_of_the_page(make: Make) -> None:
    env = make("bin_sort", object_state=True)
    flat = gym.wrappers.FlattenObservation(env)
    numbers, _ = flat.reset(seed=0)
    observation, _ = env.reset(seed=0)
    parts = [observation[name] for name in ("agent_pos", "environment_state", "tcp_pose")]
    assert numbers.dtype == np.float32
    np.testing.assert_array_equal(numbers, np.concatenate(parts))
    assert numbers in flat.observation_space


def test_a_door_that_always_stands_at_one_place_still_says_how_far_it_is_open() -> None:
    task = catalog.get("hinge_chest")
    place = replace(
        task.placements["chest"], x=Uniform(0.6, 0.6), y=Uniform(-0.2, -0.2), yaw=Uniform(0.0, 0.0)
    )
    fixed = replace(task, id="fixed", placements={**task.placements, "chest": place})
    names = fixed.object_state.names
    assert [name for name in names if name.startswith("chest")] == ["chest/lid_angle"]
    assert set(names) < set(task.object_state.names)
