import math

import manifold3d
import numpy as np
import pytest
import trimesh

from duobench.experts.handover import Bar, clasp, let_go, pick_bar
from duobench.experts.motion import Arms, Script, wait
from duobench.experts.transfer_reorient import BAR, MEETING_POINT, RECEIVER_GRIP, insert, script
from duobench.sim.layout import Layout
from duobench.solids.blocks import WHITE
from duobench.solids.hexagon_peg import (
    ACROSS_FLATS,
    BOARD_FLOOR,
    BOARD_HEIGHT,
    CLEARANCE,
    HEXAGON,
    PEG_LENGTH,
    SQUARE,
    TRIANGLE,
    Hole,
    peg,
    socket_board,
)
from duobench.solids.shapes import circle, prism
from duobench.solids.solid import PLA_DENSITY, Solid, manifold_of, mass_properties, printable
from duobench.spatial import SE3
from duobench.tasks.transfer_reorient import BLUE, DEPTH, TASK
from duobench.types import Side
from tests.handovers import bring, drop, meet
from tests.stageplay import Stageplay

LEFT, RIGHT = Side.LEFT, Side.RIGHT
BOARD = SE3.at(0.5, 0.2)
"""Where both arms reach the holes."""
LAYOUT = Layout(poses={"peg": SE3.at(0.5, -0.2, ACROSS_FLATS / 2, yaw=0.2), "board": BOARD})
TILTED_IN = {SQUARE: 0.009, TRIANGLE: 0.002}
"""How deep a corner of a peg may get that is pressed onto a hole that is too small, and tilts: it
finds the wide one, and slides off the narrow one."""
UPRIGHT = SE3.about((0, 1, 0), math.pi / 2)


@pytest.fixture(scope="module")
def bench() -> Stageplay:
    return Stageplay(TASK)


@pytest.fixture
def table(bench: Stageplay) -> Stageplay:
    bench.start(layout=LAYOUT)
    return bench


def both_hold(arms: Arms) -> Script:
    yield from meet(arms, BAR, MEETING_POINT, grip_at=RECEIVER_GRIP, slant=0.0)


def hand_over(arms: Arms) -> Script:
    yield from both_hold(arms)
    yield from let_go(arms, RIGHT)


def mouth(hole: Hole) -> SE3:
    return BOARD @ SE3.at(hole.x, 0.0, BOARD_HEIGHT)


def standing(hole: Hole, depth: float, *, aside: float = 0.0, lean: float = 0.0) -> SE3:
    """The peg upright with its lower end below a hole's mouth."""
    turned = mouth(hole) @ SE3.at(aside, 0.0, -depth) @ SE3.about((1, 0, 0), lean)
    return turned @ SE3.at(z=PEG_LENGTH / 2) @ UPRIGHT


@pytest.mark.parametrize("seed", [3, 17])
def test_the_expert_passes_the_stages_in_order(bench: Stageplay, seed: int) -> None:
    bench.start(seed)
    assert bench.run_for(script, TASK.horizon) == 4
    assert bench.history == sorted(bench.history)
    assert set(bench.history) == {0, 1, 2, 3, 4}
    assert bench.progress.final_holds
    assert bench.sim.position("peg")[2] < BOARD_HEIGHT - DEPTH + PEG_LENGTH / 2


# --- what must not count -------------------------------------------------------------------------


def test_a_peg_in_the_hole_that_nobody_handed_over_does_not_count(table: Stageplay) -> None:
    table.put(peg=standing(HEXAGON, 0.020))
    assert table.hold(20) == 0
    assert table.sim.contacts.partners("peg") == {"board"}


def test_depth_offset_and_angle_are_those_of_the_task(table: Stageplay) -> None:
    assert table.act(hand_over) == 3
    table.put(peg=standing(HEXAGON, DEPTH - 0.001))
    table.put(peg=standing(HEXAGON, DEPTH + 0.001, aside=0.005))
    table.put(peg=standing(HEXAGON, DEPTH + 0.001, lean=math.radians(11)))
    assert table.stage == 3
    table.put(peg=standing(HEXAGON, DEPTH + 0.001))
    assert table.stage == 4


@pytest.mark.parametrize("end", [1, -1])
def test_either_end_may_go_in(table: Stageplay, end: int) -> None:
    assert table.act(hand_over) == 3
    table.put(peg=standing(HEXAGON, 0.020) @ SE3.about((0, 0, 1), (1 - end) * math.pi / 2))
    assert table.stage == 4


@pytest.mark.parametrize("hole", [SQUARE, TRIANGLE], ids=["square", "triangle"])
def test_the_peg_does_not_go_into_another_hole(table: Stageplay, hole: Hole) -> None:
    def into(arms: Arms) -> Script:
        yield from hand_over(arms)
        yield from insert(arms, LEFT, mouth(hole))
        yield from wait(10)

    assert table.act(into) == 3
    assert table.sim.contacts.between("peg", "board")
    assert table.sim.lowest("peg") > BOARD_HEIGHT - TILTED_IN[hole]
    table.put(peg=standing(hole, 0.020))
    assert table.stage == 3


def test_a_peg_that_stands_on_the_board_does_not_count(table: Stageplay) -> None:
    assert table.act(hand_over) == 3
    table.act(lambda arms: drop(arms, LEFT))
    between = Hole(corners=6, apothem=0.0, x=(SQUARE.x + TRIANGLE.x) / 2, phase=0.0)
    table.put(peg=standing(between, 0.0))
    assert table.hold(10) == 3
    assert table.sim.contacts.partners("peg") == {"board"}


def test_the_arm_that_picked_it_up_may_not_insert_it(table: Stageplay) -> None:
    assert table.act(lambda arms: pick_bar(arms, BAR)) == 1
    table.act(lambda arms: drop(arms, RIGHT))
    table.put(peg=standing(HEXAGON, 0.020))
    assert table.hold(20) == 1


def test_an_arm_that_takes_part_and_lets_go_again_has_not_received(table: Stageplay) -> None:
    def keep(arms: Arms) -> Script:
        yield from both_hold(arms)
        yield from let_go(arms, LEFT)

    assert table.act(keep) == 2
    table.act(lambda arms: drop(arms, RIGHT))
    table.put(peg=standing(HEXAGON, 0.020))
    assert table.hold(20) == 2


def test_putting_it_down_for_the_other_arm_is_no_handover(table: Stageplay) -> None:
    def by_table(arms: Arms) -> Script:
        yield from pick_bar(arms, BAR)
        yield from bring(arms, RIGHT, "peg", (0.5, -0.05, ACROSS_FLATS / 2 + 0.002))
        yield from drop(arms, RIGHT)
        yield from pick_bar(arms, Bar(body="peg", giver=LEFT, grip=BAR.grip, height=BAR.height))

    assert table.act(by_table) == 1
    assert table.sim.contacts.pads(LEFT, "peg")
    table.act(lambda arms: drop(arms, LEFT))
    table.put(peg=standing(HEXAGON, 0.020))
    assert table.hold(20) == 1


def test_a_peg_that_was_handed_back_does_not_count(table: Stageplay) -> None:
    def back(arms: Arms) -> Script:
        yield from both_hold(arms)
        held_here = arms.targets[RIGHT]
        yield from let_go(arms, RIGHT)
        yield from clasp(arms, RIGHT, held_here)
        yield from let_go(arms, LEFT)

    assert table.act(back) == 3
    assert table.sim.contacts.pads(RIGHT, "peg")
    table.act(lambda arms: drop(arms, RIGHT))
    table.put(peg=standing(HEXAGON, 0.020))
    assert table.hold(20) == 3


# --- objects -------------------------------------------------------------------------------------


@pytest.mark.parametrize("solid", [peg(BLUE), socket_board(WHITE)], ids=["peg", "board"])
def test_what_collides_is_what_is_drawn_and_weighed(solid: Solid) -> None:
    mesh = printable(solid)
    drawn = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert drawn.is_watertight
    colliding = sum((manifold_of(shape) for shape in solid.shapes), manifold3d.Manifold())
    assert colliding.volume() == pytest.approx(drawn.volume, rel=1e-5)
    assert mass_properties(solid).mass == pytest.approx(drawn.volume * PLA_DENSITY)


def test_the_peg_is_a_hexagon(bench: Stageplay) -> None:
    face = ACROSS_FLATS**2 * math.sqrt(3) / 2
    assert bench.sim.model.body("peg").mass[0] == pytest.approx(face * PEG_LENGTH * PLA_DENSITY)


def _overlap(hole: Hole, turn: float, grown: float) -> float:
    """Volume in m³ of the board that a peg, grown on each side, would have to displace."""
    board = sum((manifold_of(s) for s in socket_board(WHITE).shapes), manifold3d.Manifold())
    outline = (ACROSS_FLATS / 2 + grown) * circle(6) / math.cos(math.pi / 6)
    pose = SE3.at(hole.x, 0.0, BOARD_HEIGHT / 2 + BOARD_FLOOR, yaw=turn)
    return (board ^ manifold_of(prism(outline.tolist(), BOARD_HEIGHT, at=pose))).volume()


def test_only_the_hexagonal_hole_takes_the_peg_and_with_little_play() -> None:
    for sixth in range(6):
        assert _overlap(HEXAGON, sixth * math.pi / 3, CLEARANCE - 1e-5) < 1e-12
        assert _overlap(HEXAGON, sixth * math.pi / 3, CLEARANCE + 1e-4) > 1e-8
    for hole in (SQUARE, TRIANGLE):
        for turn in np.arange(0.0, math.pi / 3, 0.05):
            assert _overlap(hole, turn, 0.0) > 1e-8


@pytest.mark.parametrize("seed", range(10))
def test_objects_rest_apart_at_reset(bench: Stageplay, seed: int) -> None:
    layout = bench.start(seed)
    assert bench.sim.contacts.deepest(0.0005) == []
    assert bench.sim.contacts.partners("peg") == {"table"}
    moved, turned = bench.sim.pose("peg").distance(layout.poses["peg"])
    assert moved < 0.001
    assert turned < 0.01
    assert bench.hold(10) == 0
    assert max(bench.sim.speed("peg")) < 0.005
    assert bench.sim.position("peg")[1] < 0 < bench.sim.position("board")[1]
