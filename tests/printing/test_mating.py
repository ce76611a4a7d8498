"""What goes together is measured on the files that a printer gets, not on the numbers behind them.

Every size in a recipe is measured here, each joint from both of its sides.
"""

from __future__ import annotations

import math

import pytest

from duobench.printing.details import DIMENSIONS
from duobench.world.objects import chest, gate, hexagon_peg, joint_blocks, maze_board
from duobench.world.objects.mazes import MAZES
from tests.printing.printed import JOBS, job, reach, solid, width

NOISE = 1e-12
"""Volume in m³ that arithmetic leaves of nothing."""
NEAR = 0.05
"""How far in mm a mating size may be off."""
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)

LUG, BARREL = (*chest.HINGE[:1], 0.118, chest.HINGE[2]), (0.0, 0.1, 0.0)
PEG_SIDE = (joint_blocks.BAR[0] / 2 + 0.010, 0.0, 0.0)
SOCKET = (joint_blocks.BAR[0] / 2 - 0.010, 0.0, 0.0)
WALL_PEG = (-joint_blocks.WALL_PLATE[0] / 2 - 0.010, 0.0, joint_blocks.PEG_HEIGHT)
TOP = gate.RING_HEIGHT - gate.RING_RADIUS
BAR_Z = TOP - gate.RING_THICKNESS / 2
KEY_Z = TOP - gate.RING_THICKNESS + gate.KEY[1] / 2
STAY = (maze_board.BAR[1] + maze_board.STAY) / 2
RIM = maze_board.EDGE / 2
FRAME, GRIP = "board-frame", "board-grip"
OUTSIDE = (RIM - 1e-6, STAY, 0.0)
DOVETAIL_END = (RIM - maze_board.DOVETAIL[0] + 1e-6, STAY, 0.0)
SLOT_END = (DOVETAIL_END[0] - 0.0002, STAY, 0.0)
MIDDLE = (0, 0, gate.RING_HEIGHT)
HOLE = (hexagon_peg.HEXAGON.x, 0.0, 0.015)
FLAT = (0.0, math.cos(math.pi / 6), math.sin(math.pi / 6))

# By recipe's entry and what is measured: part, point in the object's frame, direction.
PLACES = {
    ("hinge_chest/chest", "cavity along the hinge, between the lugs"): ("chest", (0, 0, 0.03), Y),
    ("hinge_chest/chest", "cavity across"): ("chest", (0, 0.05, 0.03), X),
    ("hinge_chest/chest", "hole in a lug, diameter"): ("chest", LUG, Z),
    ("hinge_chest/chest/lid", "length of the hinge's barrel"): ("chest-lid", (0.003, 0, 0), Y),
    ("hinge_chest/chest/lid", "hole in the barrel, diameter"): ("chest-lid", BARREL, Z),
    ("pour_marbles/left_cup", "inside, between flats"): ("left_cup", (0, 0, 0.04), X),
    ("pour_marbles/right_cup", "inside, between flats"): ("right_cup", (0, 0, 0.04), Y),
    ("ball_maze/board/frame", "slot for a dovetail, at the rim's outside"): (FRAME, OUTSIDE, Y),
    ("ball_maze/board/frame", "slot for a dovetail, at its end"): (FRAME, SLOT_END, Y),
    ("ball_maze/board/frame", "opening for a floor, above its shoulders"): (FRAME, (0, 0, 0), X),
    ("ball_maze/board/grip", "dovetail where it leaves the stay"): (GRIP, OUTSIDE, Y),
    ("ball_maze/board/grip", "dovetail at its end"): (GRIP, DOVETAIL_END, Y),
    ("ball_maze/board/grip", "bar, thickness"): (GRIP, (maze_board.GRIP_OFFSET, 0.0, 0.0), X),
    ("join_blocks/light_block", "peg, either way across"): ("light_block", PEG_SIDE, Y),
    ("join_blocks/dark_block", "sockets, either way across"): ("dark_block", SOCKET, Y),
    ("join_blocks/wall", "peg, either way across"): ("wall", WALL_PEG, Y),
    ("transfer_gate/gate/base", "hole for the post"): ("gate-base", (0, 0, 0.012), X),
    ("transfer_gate/gate/post", "edge of the post"): ("gate-post", (0, 0, 0.1), X),
    ("transfer_gate/gate/post", "slot for the ring"): ("gate-post", (0.01, 0, BAR_Z), Y),
    ("transfer_gate/gate/post", "key in the slot"): ("gate-post", (0, 0, KEY_Z), X),
    ("transfer_gate/gate/ring", "bar of the ring, across"): ("gate-ring", (0.02, 0, BAR_Z), Y),
    ("transfer_gate/gate/ring", "notch for the key"): ("gate-ring", (0, 0, KEY_Z), X),
    ("transfer_gate/gate/ring", "opening, between flats"): ("gate-ring", MIDDLE, X),
    ("transfer_reorient/peg", "between flats"): ("peg", (0, 0, 0), Z),
    ("transfer_reorient/board", "hexagonal hole, between flats"): ("board", HOLE, Y),
}
MEASURED_BELOW = {
    ("join_blocks/dark_block", "depth of a socket"),
    ("join_blocks/wall", "height of the peg's middle"),
    ("ball_maze/board/floor", "way between walls"),
}
SIZES = {(key, size.what): size.mm for key, sizes in DIMENSIONS.items() for size in sizes}


def test_every_size_of_a_recipe_is_measured() -> None:
    assert set(SIZES) == {*PLACES, *MEASURED_BELOW}
    with_own = {name for name in JOBS for each in job(name).parts if each.sizes}
    assert with_own == {"jig"}, "those of the jig are measured beside it"


@pytest.mark.parametrize("key", PLACES, ids=": ".join)
def test_a_part_has_the_size_that_its_recipe_asks_for(key: tuple[str, str]) -> None:
    of, at, way = PLACES[key]
    assert width(key[0].split("/")[0], of, at, way) == pytest.approx(SIZES[key], abs=NEAR)


@pytest.mark.parametrize("way", [Y, Z])
@pytest.mark.parametrize("end", [1, -1])
def test_square_pegs_have_the_play_of_the_simulation_in_square_sockets(
    way: tuple[float, ...], end: int
) -> None:
    socket = width("join_blocks", "dark_block", (end * SOCKET[0], 0.0, 0.0), way)
    for of, at in (("light_block", PEG_SIDE), ("wall", WALL_PEG)):
        play = (socket - width("join_blocks", of, at, way)) / 2
        assert play == pytest.approx(1000 * joint_blocks.CLEARANCE, abs=NEAR)


def test_pegs_reach_their_sockets_and_meet_no_bottom() -> None:
    face = joint_blocks.BAR[0] / 2
    depth = reach("join_blocks", "dark_block", (face, 0.0, 0.0), (-1.0, 0.0, 0.0))
    assert depth == pytest.approx(SIZES["join_blocks/dark_block", "depth of a socket"], abs=NEAR)
    light = reach("join_blocks", "light_block", (face, 0.0, 0.0), X)
    wall = reach("join_blocks", "wall", (-0.010, 0.0, joint_blocks.PEG_HEIGHT), (-1.0, 0.0, 0.0))
    assert light == pytest.approx(1000 * joint_blocks.PEG_LENGTH, abs=NEAR)
    assert wall == pytest.approx(light, abs=NEAR)
    assert light < depth


def test_the_peg_on_the_wall_is_as_high_as_the_recipe_says() -> None:
    down, up = (reach("join_blocks", "wall", WALL_PEG, (0.0, 0.0, s)) for s in (-1.0, 1.0))
    low = 1000 * solid("join_blocks", "wall").bounding_box()[2]
    middle = 1000 * WALL_PEG[2] + (up - down) / 2 - low
    expected = SIZES["join_blocks/wall", "height of the peg's middle"]
    assert middle == pytest.approx(expected, abs=NEAR)


@pytest.mark.parametrize("turn", range(3))
def test_the_hexagonal_peg_has_its_play_on_every_side(turn: int) -> None:
    angle = math.pi / 2 + turn * math.pi / 3
    peg = width("transfer_reorient", "peg", (0, 0, 0), (0.0, math.cos(angle), math.sin(angle)))
    hole = width("transfer_reorient", "board", HOLE, (math.cos(angle), math.sin(angle), 0.0))
    assert (hole - peg) / 2 == pytest.approx(1000 * hexagon_peg.CLEARANCE, abs=NEAR)


def test_the_lid_turns_between_the_lugs_about_the_holes_of_both() -> None:
    beside = (chest.HINGE[0] + 0.003, 0.0, chest.HINGE[2])
    between = width("hinge_chest", "chest", beside, Y)
    barrel = width("hinge_chest", "chest-lid", (0.003, 0, 0), Y)
    assert (between - barrel) / 2 == pytest.approx(1000 * chest.GAP, abs=NEAR)
    for of, hole in (("chest", LUG), ("chest-lid", BARREL)):
        for way in (X, Z):
            ahead, behind = (
                reach("hinge_chest", of, hole, (s * way[0], 0.0, s * way[2])) for s in (1, -1)
            )
            assert ahead == pytest.approx(behind, abs=NEAR)


@pytest.mark.parametrize("way", [X, Y])
def test_the_post_has_its_play_in_the_base(way: tuple[float, ...]) -> None:
    hole = width("transfer_gate", "gate-base", (0, 0, 0.012), way)
    post = width("transfer_gate", "gate-post", (0, 0, 0.012), way)
    assert (hole - post) / 2 == pytest.approx(0.2, abs=NEAR)


def test_the_ring_lies_on_the_floor_of_its_slot_over_the_key() -> None:
    both = ("gate-post", "gate-ring")
    floor, bar = (reach("transfer_gate", of, (0.01, 0.0, 0.1), Z) for of in both)
    assert bar == pytest.approx(floor, abs=NEAR)
    key, notch = (reach("transfer_gate", of, (0.0, 0.0, 0.1), Z) for of in both)
    assert notch - key == pytest.approx(0.2, abs=NEAR)
    slot, across = (width("transfer_gate", of, (0.01, 0, BAR_Z), Y) for of in both)
    assert (slot - across) / 2 == pytest.approx(0.2, abs=NEAR)


def test_a_dovetail_has_its_play_in_the_slot_of_the_frame() -> None:
    for inwards in (0.0005, 0.004, 0.0075):
        at = (RIM - inwards, STAY, 0.0)
        slot, dovetail = (width("ball_maze", of, at, Y) for of in (FRAME, GRIP))
        assert (slot - dovetail) / 2 == pytest.approx(0.2, abs=NEAR)


@pytest.mark.parametrize("number", range(len(MAZES)))
def test_any_floor_stands_in_the_frame_and_the_frame_lifts_it(number: int) -> None:
    frame, floor = solid("ball_maze", FRAME), solid("ball_maze", f"board_{number}-floor")
    assert floor.bounding_box()[2] == pytest.approx(frame.bounding_box()[2], abs=1e-7)
    assert floor.bounding_box()[5] == pytest.approx(maze_board.WALL_HEIGHT, abs=1e-7)
    play = maze_board.FLOOR_PLAY
    for way in (X, Y):
        for sign in (-1, 1):
            here, there = (
                floor.translate([share * sign * play * each for each in way])
                for share in (0.95, 1.05)
            )
            assert (here ^ frame).volume() < NOISE
            assert (there ^ frame).volume() > NOISE
    # In the air it sinks by the play, and no further; upwards nothing holds it.
    assert (floor.translate([0, 0, -0.95 * play]) ^ frame).volume() < NOISE
    assert (floor.translate([0, 0, -1.05 * play]) ^ frame).volume() > NOISE
    for rise in (0.002, 0.01, 0.03):
        assert (floor.translate([0, 0, rise]) ^ frame).volume() < NOISE
    # The other way up it does not go in, so that nobody lays it wrongly.
    assert (floor.rotate([180, 0, 0]) ^ frame).volume() > NOISE


def test_a_ball_has_the_ways_of_the_maze_to_itself() -> None:
    expected = SIZES["ball_maze/board/floor", "way between walls"]
    ball = width("ball_maze", "ball", (0, 0, 0), X)
    assert ball == pytest.approx(1000 * 2 * maze_board.BALL_RADIUS, abs=NEAR)
    for number, maze in enumerate(MAZES):
        wall = next(s for s in sorted(maze.walls, key=str) if s.along_x)
        x, y = maze_board.cell_centre(wall.cell)
        # From the middle of the cell up to the wall, which is half a way.
        up = reach("ball_maze", f"board_{number}-floor", (x, y, 0.008), Y)
        assert 2 * up == pytest.approx(expected, abs=NEAR)
