import math

import manifold3d
import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, Side
from duobench.tasks.experts.handover import let_go, pick_bar
from duobench.tasks.experts.motion import Arms, Script
from duobench.tasks.experts.scripts.transfer_reorient import (
    BAR,
    MEETING_POINT,
    RECEIVER_GRIP,
    RISE,
    insert,
    lead,
    upright,
)
from duobench.tasks.stages.placing import REST_SECONDS
from duobench.tasks.stages.predicates import STILL_SPEED
from duobench.tasks.transfer_reorient import DEPTH
from duobench.world.objects.blocks import WHITE
from duobench.world.objects.hexagon_peg import (
    ACROSS_FLATS,
    BOARD_FLOOR,
    BOARD_HEIGHT,
    CLEARANCE,
    HEXAGON,
    PEG_LENGTH,
    SQUARE,
    TRIANGLE,
    PolygonHole,
    socket_board,
)
from duobench.world.objects.shapes import circle, prism
from duobench.world.objects.solid import manifold_of
from duobench.world.sim.layout import Layout
from tests.steps import do, meet, pause
from tests.task_harness import Moments, TaskHarness

LEFT, RIGHT = Side.LEFT, Side.RIGHT
BOARD = SE3.at(0.5, 0.2)
"""Where both arms reach the holes."""
LAYOUT = Layout(poses={"peg": SE3.at(0.5, -0.2, ACROSS_FLATS / 2, yaw=0.2), "board": BOARD})
REST_STEPS = round(REST_SECONDS * CONTROL_HZ) + 1
TILTED_IN = {SQUARE: 0.009, TRIANGLE: 0.002}
"""How deep a corner of a peg may get that is pressed onto a hole that is too small, and tilts: it
finds the wide one, and slides off the narrow one."""
UPRIGHT = SE3.about((0, 1, 0), math.pi / 2)


@pytest.fixture(scope="module")
def moments(bench: TaskHarness) -> Moments:
    """States by letter: held by (r)ight, (b)oth, (l)eft alone, by left (i)n the hole, by left with
    the (t)ip in it, by left a little (a)bove it, by left (o)ut of it, (f)ree in the hole.
    """
    moments = Moments(bench, LAYOUT)
    keep = moments.keep

    def whole_way(arms: Arms) -> Script:
        yield from pick_bar(arms, BAR)
        keep("r")
        yield from meet(arms, BAR, MEETING_POINT, rise=RISE, grip_at=RECEIVER_GRIP)
        keep("b")
        yield from let_go(arms, RIGHT)
        keep("l")
        yield from insert(arms, LEFT, mouth(HEXAGON))
        keep("i")
        for letter, height in (("t", -0.006), ("a", 0.008), ("o", 0.020)):
            goal = upright(arms, LEFT, mouth(HEXAGON)).moved(z=height)
            yield from lead(arms, LEFT, goal, speed=0.06)
            keep(letter)
        yield from insert(arms, LEFT, mouth(HEXAGON))
        yield from let_go(arms, LEFT)
        keep("f")

    moments.start()
    bench.act(whole_way)
    return moments


def stage_after(moments: Moments, letters: str, **peg: SE3) -> int:
    """The stage after moments, and then with the peg free at a pose, for as long as it rests before
    it counts.
    """
    stage = moments.stage_after(letters.replace("f", "f" * REST_STEPS))
    if not peg:
        return stage
    moments.at("f")
    moments.bench.put(**peg)
    return moments.bench.rest(REST_STEPS)


def mouth(hole: PolygonHole) -> SE3:
    return BOARD @ SE3.at(hole.x, 0.0, BOARD_HEIGHT)


def standing(hole: PolygonHole, depth: float, *, aside: float = 0.0, lean: float = 0.0) -> SE3:
    """The peg upright with its lower end below a hole's mouth."""
    turned = mouth(hole) @ SE3.at(aside, 0.0, -depth) @ SE3.about((1, 0, 0), lean)
    return turned @ SE3.at(z=PEG_LENGTH / 2) @ UPRIGHT


# --- what must not count; what two arms can do of it is in tests/ways ----------------------------


@pytest.mark.parametrize(
    ("letters", "stage"),
    [
        ("rblif", 4),
        ("rblf", 3),  # dropped in from above
        ("rblaf", 4),  # let go a little above it
        ("rbltaf", 4),
        ("rblof", 3),
        ("rbltf", 4),  # its tip was in the hole
        ("rbltof", 3),
        ("rbliof", 3),  # on its way out
        ("rbliloif", 4),  # and in again
        ("rblffffif", 3),  # dropped in, and pinched there
    ],
)
def test_a_peg_counts_where_it_was_led_in_and_let_go(
    moments: Moments, letters: str, stage: int
) -> None:
    assert stage_after(moments, letters) == stage


@pytest.mark.parametrize(
    ("pose", "stage"),
    [
        (standing(HEXAGON, DEPTH + 0.001), 4),
        (standing(HEXAGON, DEPTH - 0.001), 3),
        (standing(HEXAGON, DEPTH + 0.001, aside=0.005), 3),
        (standing(HEXAGON, DEPTH + 0.001, lean=math.radians(11)), 3),
        (standing(HEXAGON, 0.020) @ SE3.about((0, 0, 1), math.pi), 4),
        (standing(SQUARE, 0.020), 3),
        (standing(TRIANGLE, 0.020), 3),
        (
            standing(
                PolygonHole(corners=6, apothem=0.0, x=(SQUARE.x + TRIANGLE.x) / 2, phase=0.0), 0.0
            ),
            3,
        ),
    ],
    ids=["in", "too high", "aside", "leaning", "other end", "square", "triangle", "on the board"],
)
def test_depth_offset_and_angle_are_those_of_the_task(
    moments: Moments, pose: SE3, stage: int
) -> None:
    assert stage_after(moments, "rbli", peg=pose) == stage


def test_a_peg_that_moves_does_not_count(moments: Moments) -> None:
    stage_after(moments, "rbli")
    moments.at("f")
    for speed, stage in ((STILL_SPEED + 0.01, 3), (0.0, 4)):
        moments.bench.push("peg", speed)
        assert moments.bench.rest(REST_STEPS) == stage


@pytest.mark.parametrize("hole", [SQUARE, TRIANGLE], ids=["square", "triangle"])
def test_the_peg_does_not_go_into_another_hole(moments: Moments, hole: PolygonHole) -> None:
    table = moments.bench
    assert stage_after(moments, "rbl") == 3
    table.arms = Arms(table.sim)
    assert table.act(do((insert, LEFT, mouth(hole)), (pause, 10))) == 3
    assert table.sim.contacts.between("peg", "board")
    assert table.sim.min_height("peg") > BOARD_HEIGHT - TILTED_IN[hole]


# --- objects -------------------------------------------------------------------------------------


def _overlap(hole: PolygonHole, turn: float, grown: float) -> float:
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
