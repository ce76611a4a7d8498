import math
from dataclasses import replace

import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.tasks.ball_maze import AT_GOAL, RAISE, TASK
from duobench.tasks.experts.handling import carry
from duobench.tasks.experts.motion import down, grip, release
from duobench.tasks.experts.scripts.ball_maze import grasp, lift, script
from duobench.tasks.stages.placing import REST_SECONDS
from duobench.tasks.stages.rolling import SLIP_SECONDS
from duobench.world.objects.maze_board import (
    BALL_RADIUS,
    BASE,
    CELLS,
    PITCH,
    WALL,
    WALL_HEIGHT,
    cell_at,
    cell_centre,
    wall_numbers,
    wall_variants,
)
from duobench.world.objects.mazes import CORNERS, MAZES, Cell, Direction, Maze
from duobench.world.sim.contacts import Limb, limb_owner
from duobench.world.sim.layout import Layout
from tests.steps import do, pause, to
from tests.task_harness import TaskHarness

HALF_ROOM = (CELLS * PITCH - WALL) / 2 - BALL_RADIUS
"""How far the ball's centre can be from the board's along either axis, in metres."""
REST = round(REST_SECONDS * CONTROL_HZ)
"""Control steps for which the ball must stay in the goal."""
SLIP = round(SLIP_SECONDS * CONTROL_HZ)
"""Control steps for which the board may slip."""
MIDDLE: Cell = (CELLS // 2, CELLS // 2)
"""A cell on the way."""


def layout_of(bench: TaskHarness, board: int, seed: int = 0) -> Layout:
    """A seed's layout with another board."""
    return TASK.arrange(replace(bench.start(seed), variants={"board": str(board)}))


def on_board(bench: TaskHarness, x: float, y: float, z: float = BALL_RADIUS) -> SE3:
    """A pose of the ball in the table frame, from a point of the board's."""
    return bench.sim.pose("board") @ SE3.at(x, y, z)


def maze_of(bench: TaskHarness) -> Maze:
    """The maze of the episode's board."""
    return MAZES[int(bench.sim.variants["board"])]


def put_in(bench: TaskHarness, *cells: Cell) -> None:
    """Put the ball into the middles of cells, one after the other."""
    for cell in cells:
        bench.put(ball=on_board(bench, *cell_centre(cell)))


def rest_at_goal(bench: TaskHarness, steps: int = REST) -> int:
    """Put the ball into the goal for some control steps; the stage after them."""
    put_in(bench, *[maze_of(bench).goal] * steps)
    return bench.stage


def ball(bench: TaskHarness) -> tuple[float, float, float]:
    return bench.sim.relative_position("ball", "board")


GRASP = do((grasp, *SIDES))
LIFT = do(GRASP, (lift, *SIDES))


def grasped(bench: TaskHarness) -> np.ndarray:
    """An episode in which both arms grasp the board, which lies on the table; the state."""
    bench.start(0)
    assert bench.act(GRASP) == 2
    assert bench.sim.contacts.between("board", "table")
    return bench.sim.get_state()


def lifted(bench: TaskHarness, *cells: Cell, seed: int = 0) -> np.ndarray:
    """An episode in which both arms hold the board level in the air, with the ball at the start;
    the state. Then the ball is put into cells.
    """
    bench.start(seed)
    assert bench.act(LIFT) == 2
    aloft = bench.sim.get_state()
    put_in(bench, *cells)
    return aloft


def push_ball(bench: TaskHarness, speed: float, angle: float) -> None:
    """Let the ball roll at a speed in m/s, at an angle in the board's plane."""
    direction = bench.sim.rotation("board") @ [math.cos(angle), math.sin(angle), 0.0]
    bench.push("ball", *(speed * direction))


@pytest.mark.parametrize("number", range(len(MAZES)))
def test_the_expert_solves_every_board_and_passes_the_stages_in_order(
    bench: TaskHarness, number: int
) -> None:
    bench.start(layout=layout_of(bench, number, seed=number))
    assert bench.run_for(script, TASK.horizon) == 4
    assert bench.history == sorted(bench.history)
    assert sorted(set(bench.history)) == [0, 1, 2, 3, 4]
    assert bench.progress.final_holds


def test_only_the_goal_of_its_own_board_counts(bench: TaskHarness) -> None:
    lifted(bench, MIDDLE)
    for maze in MAZES:
        if maze.goal != maze_of(bench).goal:
            put_in(bench, *[maze.goal] * 2 * REST)
            assert bench.stage == 3
    assert rest_at_goal(bench) == 4


def test_a_ball_that_passes_the_goal_does_not_count(bench: TaskHarness) -> None:
    lifted(bench)
    for _ in range(3):
        put_in(bench, MIDDLE)
        assert rest_at_goal(bench, REST - 1) == 3
    assert rest_at_goal(bench, 1) == 4
    # One that skipped the way takes a step more.
    lifted(bench)
    assert rest_at_goal(bench) == 3
    assert rest_at_goal(bench, 1) == 4


@pytest.mark.parametrize(("beyond", "stage"), [(-0.001, 4), (0.001, 3)])
def test_a_ball_in_the_goals_cell_counts_up_to_15_mm_from_its_centre(
    bench: TaskHarness, beyond: float, stage: int
) -> None:
    lifted(bench, MIDDLE)
    x, y = cell_centre(maze_of(bench).goal)
    # Towards the middle of the board, where nothing stands.
    toward = -math.copysign((AT_GOAL + beyond) / math.sqrt(2), x)
    for _ in range(REST):
        bench.put(ball=on_board(bench, x + toward, y - math.copysign(toward, y)))
    assert bench.stage == stage


def test_a_ball_off_the_board_does_not_count(bench: TaskHarness) -> None:
    lifted(bench)
    x, y, _ = bench.sim.position("board")
    elsewhere = SE3.at(x + 0.25, y, BALL_RADIUS)
    goal = cell_centre(maze_of(bench).goal)
    below_the_goal = on_board(bench, *goal, z=-0.02)
    above_the_goal = on_board(bench, *goal, z=WALL_HEIGHT + 0.001)
    for pose in (elsewhere, below_the_goal, above_the_goal):
        for _ in range(2 * REST):
            bench.put(ball=pose)
        assert bench.stage == 2


@pytest.mark.parametrize(("steps", "stage"), [(SLIP, 4), (SLIP + 1, 3)])
def test_the_half_second_is_not_broken_by_a_grasp_that_slips(
    bench: TaskHarness, steps: int, stage: int
) -> None:
    lifted(bench)
    bench.act(do((release, Side.LEFT)))
    bench.hold(30)
    slipped = bench.sim.get_state()
    aloft = lifted(bench, MIDDLE)
    for state, count in ((aloft, 5), (slipped, steps), (aloft, REST - 5 - steps)):
        bench.sim.set_state(state)
        rest_at_goal(bench, count)
    assert bench.stage == stage
    assert rest_at_goal(bench, REST) == 4


def test_at_the_end_of_the_half_second_both_arms_hold_the_board(bench: TaskHarness) -> None:
    lifted(bench, MIDDLE)
    aloft = bench.sim.get_state()
    assert rest_at_goal(bench, REST - 1) == 3
    bench.act(do((release, Side.LEFT)))
    assert rest_at_goal(bench, 2 * REST) == 3
    bench.sim.set_state(aloft)
    bench.judge()
    assert solved_from_the_start(bench)


@pytest.mark.parametrize("rolled", [True, False])
@pytest.mark.parametrize(("steps", "spoilt"), [(0, False), (1, False), (4, True)])
def test_a_ball_that_rolls_on_a_board_put_down_again_does_not_count(
    bench: TaskHarness, rolled: bool, steps: int, spoilt: bool
) -> None:
    on_table = grasped(bench)
    aloft = lifted(bench, *[MIDDLE] * rolled)
    bench.sim.set_state(on_table)
    put_in(bench, MIDDLE)
    push_ball(bench, 0.1, 0.0)
    bench.rest(steps)
    bench.sim.set_state(aloft)
    put_in(bench, MIDDLE)
    rest_at_goal(bench)
    assert bench.stage == (4 if not spoilt else 3 if rolled else 2)
    assert solved_from_the_start(bench)


def test_a_ball_at_the_goal_of_a_board_on_the_table_does_not_count(bench: TaskHarness) -> None:
    on_table = grasped(bench)
    assert bench.act(do((lift, *SIDES))) == 2
    aloft = bench.sim.get_state()
    put_in(bench, MIDDLE)
    # What came to another cell down there has to begin again.
    for state in (on_table, aloft):
        bench.sim.set_state(state)
        assert rest_at_goal(bench) == 3
    assert solved_from_the_start(bench)


@pytest.mark.parametrize(("above", "stage"), [(-0.001, 2), (0.001, 3)])
def test_a_board_is_lifted_from_10_mm_on(bench: TaskHarness, above: float, stage: int) -> None:
    grasped(bench)
    x, y, _ = bench.sim.position("board")
    # The grips slide up between the pads.
    bench.sim.place("board", SE3.at(x, y, BASE + RAISE + above, yaw=bench.sim.pose("board").yaw))
    bench.sim.forward()
    put_in(bench, maze_of(bench).start, MIDDLE)
    assert all(bench.sim.contacts.grasped(side, "board") for side in SIDES)
    assert bench.stage == stage


def test_a_board_that_leans_on_the_table_is_not_lifted(bench: TaskHarness) -> None:
    lifted(bench, seed=2)
    pose = bench.sim.pose("board")
    apart = bench.arms.tcp_pose(Side.LEFT).translation - bench.arms.tcp_pose(Side.RIGHT).translation
    turn = SE3.about(np.cross((0.0, 0.0, 1.0), apart), 0.2)
    low = np.array([*pose.translation[:2], BASE + 0.010])
    leaning = SE3(turn.rotation @ pose.rotation, low)
    at = ball(bench)

    for _ in do((carry, "board", leaning, {"speed": 0.1}), (pause, 12))(bench.arms):
        bench.advance()
        bench.put(ball=on_board(bench, *at))
    assert bench.sim.contacts.between("board", "table")
    assert bench.sim.position("board")[2] > BASE + RAISE
    bench.put(ball=on_board(bench, 0.0, 0.0))
    assert bench.stage == 2


def solved_from_the_start(bench: TaskHarness) -> bool:
    """Whether the whole way, in the air and in this very moment, is success."""
    put_in(bench, maze_of(bench).start, MIDDLE)
    return rest_at_goal(bench) == 4


def touched(bench: TaskHarness, limb: Limb) -> None:
    """For one step let a part of the left arm touch the ball, where it lies on the board."""
    before = bench.sim.get_state()
    owner = limb_owner(Side.LEFT, limb)
    for point in bench.sim.data.geom_xpos.copy():
        bench.sim.place("ball", SE3.at(*point))
        bench.sim.place("board", SE3.at(*point).moved(z=-BALL_RADIUS))
        bench.sim.forward()
        if owner in bench.sim.contacts.partners("ball") <= {owner, "board"}:
            break
    assert bench.sim.contacts.between("ball", owner)
    bench.judge()
    bench.sim.set_state(before)


@pytest.mark.parametrize("limb", [Limb.PALM, Limb.ARM])
def test_a_ball_that_the_robot_moved_does_not_count(bench: TaskHarness, limb: Limb) -> None:
    lifted(bench)
    touched(bench, limb)
    assert rest_at_goal(bench, REST + 1) == 2

    put_in(bench, maze_of(bench).start, MIDDLE)
    assert bench.stage == 3
    touched(bench, limb)
    assert rest_at_goal(bench, REST + 1) == 3
    assert solved_from_the_start(bench)


@pytest.mark.parametrize(("above", "stages"), [(-0.001, (3, 4)), (0.001, (2, 3))])
def test_a_ball_that_hops_higher_than_the_walls_does_not_count(
    bench: TaskHarness, above: float, stages: tuple[int, int]
) -> None:
    lifted(bench)
    hop = on_board(bench, 0.0, 0.0, z=WALL_HEIGHT + above)
    bench.put(ball=hop)
    bench.put(ball=on_board(bench, 0.0, 0.0))
    assert bench.stage == stages[0]
    put_in(bench, maze_of(bench).start, MIDDLE)
    bench.put(ball=hop)
    assert rest_at_goal(bench) == stages[1]
    assert solved_from_the_start(bench)


def test_a_touch_before_the_board_is_taken_up_does_no_harm(bench: TaskHarness) -> None:
    bench.start(layout=layout_of(bench, 0))
    x, y, z = bench.sim.position("ball")
    above, left = down(x, y, z + 0.10), Side.LEFT
    touch = do(
        (grip, left),
        (to, left, above),
        (to, left, above.moved(z=-0.07), {"speed": 0.15}),
        (to, left, above, {"speed": 0.3}),
        (to, left, down(0.5, 0.25, 0.3)),
    )
    bench.act(touch)
    assert bench.run_for(script, TASK.horizon) == 4


@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_the_ball_cannot_leave_a_level_board(bench: TaskHarness, speed: float) -> None:
    for angle in np.linspace(0, 2 * math.pi, 8, endpoint=False):
        bench.start(0)
        for number in wall_numbers().values():
            wall = bench.sim.model.geom(f"board:{number}")
            wall.contype, wall.conaffinity = 0, 0
        bench.put(ball=on_board(bench, 0.0, 0.0))
        push_ball(bench, speed, angle)
        bench.hold(45)
        x, y, z = ball(bench)
        assert max(abs(x), abs(y)) < HALF_ROOM + 0.002
        assert z == pytest.approx(BALL_RADIUS, abs=0.001)


def test_the_walls_of_the_layouts_maze_stand_and_no_others(bench: TaskHarness) -> None:
    model = bench.sim.model
    images = {board: variant.without_images for board, variant in wall_variants().items()}
    for board in (9, 0, 4, 4, 1):
        bench.start(layout=layout_of(bench, board))
        for segment, number in wall_numbers().items():
            geom = model.geom(f"board:{number}")
            stands = segment in MAZES[board].walls
            assert (geom.contype[0] > 0) == (geom.conaffinity[0] > 0) == stands
        seen = {
            number
            for number in frozenset().union(*images.values())
            if model.geom(f"board:image{number}").rgba[3]
        }
        assert seen == frozenset().union(*images.values()) - images[str(board)]
        assert len(seen) == 1 + len(CORNERS)


def test_the_ball_begins_in_its_cell_and_rolls_through_a_passage_up_to_a_wall(
    bench: TaskHarness,
) -> None:
    for board, maze in enumerate(MAZES):
        direction = next(way for way in Direction if maze.is_open(maze.start, way))
        bench.start(layout=layout_of(bench, board))
        assert bench.hold(10) == 0
        assert ball(bench) == pytest.approx([*cell_centre(maze.start), BALL_RADIUS], abs=0.002)
        push_ball(bench, 0.4, math.atan2(*reversed(direction.value)))
        bench.hold(45)
        assert cell_at(*ball(bench)[:2]) == maze.run(maze.start, direction)
