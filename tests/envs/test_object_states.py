"""Object states: the numbers are those of the simulation, of what the layout chose, and named."""

import re
from collections.abc import Mapping
from itertools import product

import gymnasium as gym
import numpy as np
import pytest

from duobench.envs import sim_of
from duobench.objects import cup
from duobench.objects.maze_board import cell_centre
from duobench.objects.mazes import CELLS, MAZES, Direction, Segment
from duobench.sim.simulation import Simulation
from duobench.tasks import catalog
from tests.envs.tools import equal, make_small, waves

SPEED, OPENED = 0.5, 0.7
"""What objects are kicked with, in m/s and rad/s, and how far hinges are opened, in radians."""
MOVED, ROUNDING = 1e-3, 1e-6


def named(env: gym.Env, observation: Mapping[str, np.ndarray]) -> dict[str, float]:
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


def check(env: gym.Env, observation: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Compare an observation with the engine."""
    found = named(env, observation)
    assert observation["environment_state"] in env.observation_space["environment_state"]  # type: ignore[index]
    simulation = sim_of(env).simulation
    expected = {name: measured(simulation, name) for name in found}
    compared = {name: value for name, value in expected.items() if value is not None}
    assert compared
    assert {name: found[name] for name in compared} == pytest.approx(compared, abs=ROUNDING)
    return found


@pytest.mark.parametrize("task", catalog.names())
def test_numbers_are_those_of_the_simulation(task: str) -> None:
    env = make_small(task, object_state=True)
    observation, _ = env.reset(seed=0)
    first, state = check(env, observation), env.get_wrapper_attr("save_state")()
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
    restored, _ = env.get_wrapper_attr("restore_state")(state)
    assert equal(restored, observation)
    env.close()


def test_the_full_cup_is_the_one_with_the_marbles() -> None:
    env = make_small("pour_marbles", object_state=True)
    seen = set()
    for seed in range(8):
        observation, info = env.reset(seed=seed)
        found, full = named(env, observation), info["layout"]["variants"]["full"]
        seen.add(full)
        for side in ("left", "right"):
            is_full = side == full
            assert found[f"full_is_{side}"] == found[f"marbles_in_{side}_cup"] == is_full
        middle = [found[f"marbles_{axis}"] - found[f"{full}_cup_{axis}"] for axis in "xyz"]
        assert np.hypot(*middle[:2]) < cup.MARBLE_RADIUS
        assert 0 < found["marbles_spread"] < cup.INNER_RADIUS
    assert seen == {"left", "right"}
    env.close()


def test_walls_start_and_goal_are_those_of_the_board() -> None:
    env = make_small("ball_maze", object_state=True)
    boards = set()
    for seed in range(12):
        observation, info = env.reset(seed=seed)
        found, board = named(env, observation), info["layout"]["variants"]["board"]
        boards.add(board)
        maze = MAZES[int(board)]
        assert tuple(found[f"start_{along}"] for along in ("column", "row")) == maze.start
        assert tuple(found[f"goal_{along}"] for along in ("column", "row")) == maze.goal
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
    env.close()


def test_one_vector_holds_everything_in_the_order_of_the_page() -> None:
    env = make_small("bin_sort", object_state=True)
    flat = gym.wrappers.FlattenObservation(env)
    numbers, _ = flat.reset(seed=0)
    observation, _ = env.reset(seed=0)
    parts = [observation[name] for name in ("agent_pos", "environment_state", "tcp_pose")]
    assert numbers.dtype == np.float32
    np.testing.assert_array_equal(numbers, np.concatenate(parts))
    assert numbers in flat.observation_space
    env.close()
