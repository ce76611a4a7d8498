import math
from itertools import product

import pytest

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.tasks.experts.handling import pick_cube
from duobench.tasks.experts.motion import Arms, down, release
from duobench.tasks.stages.placing import REST_SECONDS
from duobench.tasks.stages.vessels import Vessel
from duobench.world.objects.blocks import CUBE_EDGE
from duobench.world.objects.bowl import FLOOR, RADIUS, RIM_HEIGHT, WALL
from duobench.world.scene.naming import TABLE
from tests.predicate_probe import PredicateProbe
from tests.steps import Act, by, do, to
from tests.task_harness import TaskHarness

IN_BOWL = SE3.at(z=FLOOR + CUBE_EDGE / 2 - 0.0002)
"""Pose of a cube in the bowl that it lies in."""
BOWL = Vessel(body="white_bowl", radius=RADIUS - WALL, rim=RIM_HEIGHT, floor=FLOOR)
COLOUR = {Side.LEFT: "white", Side.RIGHT: "black"}
GRASP_HEIGHT = 0.028
IN_THE_BOWL = 0.027
"""Height of the tool that presses a cube on its bowl's floor, in metres."""
REST_STEPS = round(REST_SECONDS * CONTROL_HZ) + 1


def lies(bench: TaskHarness) -> bool:
    """Whether the white cube lies in the white bowl, whoever brought it."""
    return PredicateProbe(BOWL.holds("white_cube"), bench.sim).ask()


def bring(side: Side, height: float = IN_THE_BOWL) -> Act:
    """An arm picks up the cube on its side and brings it into its bowl, the tool at a height."""

    def low(arms: Arms, z: float) -> SE3:
        x, y, _ = arms.sim.position(f"{COLOUR[side]}_bowl")
        return down(x, y, z)

    return do(
        (pick_cube, side, f"{COLOUR[side]}_cube", GRASP_HEIGHT),
        (to, side, lambda arms: low(arms, 0.12)),
        (to, side, lambda arms: low(arms, height), {"speed": 0.1}),
    )


def let_go(side: Side) -> Act:
    return do((release, side), (by, side, {"z": 0.1}))


@pytest.mark.parametrize(("one", "other"), [SIDES, SIDES[::-1]])
def test_a_cube_in_its_bowl_counts_and_both_are_the_end(
    bench: TaskHarness, one: Side, other: Side
) -> None:
    bench.start(0)
    assert bench.act(bring(one)) == 2
    assert bench.act(let_go(one)) == 3
    assert bench.act(bring(other)) == 4
    bench.act(let_go(other))
    assert bench.hold(REST_STEPS) == 5


def test_cubes_that_no_hand_brought_do_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    bench.put(
        **{f"{each}_cube": bench.sim.pose(f"{each}_bowl") @ IN_BOWL for each in COLOUR.values()}
    )
    assert bench.hold(2 * REST_STEPS) == 0
    assert lies(bench)


def test_a_cube_that_is_dropped_may_be_picked_up_again(bench: TaskHarness) -> None:
    bench.start(0)
    bench.act(bring(Side.LEFT, 0.12))
    assert bench.act(let_go(Side.LEFT)) == 1
    bench.act(bring(Side.LEFT))
    assert bench.act(let_go(Side.LEFT)) == 3


def test_both_cubes_lifted_together_are_stage_two(bench: TaskHarness) -> None:
    bench.start(0)
    for stage, side in enumerate(SIDES, 1):
        assert bench.act(do((pick_cube, side, f"{COLOUR[side]}_cube", GRASP_HEIGHT))) == stage


@pytest.mark.parametrize(
    ("speed", "direction"), [*product((0.06, 0.5, 1.5), (0, 2)), (0.6, 5)], ids=str
)
def test_a_cube_that_flies_through_its_bowl_or_spins_there_does_not_count(
    bench: TaskHarness, speed: float, direction: int
) -> None:
    bench.start(0)
    bench.sim.place("white_cube", bench.sim.pose("white_bowl") @ IN_BOWL)
    bench.push("white_cube", speed, first=direction)
    assert bench.sim.contacts.between("white_cube", "white_bowl")
    assert not lies(bench)


def tipped(degrees: float) -> SE3:
    """A bowl that is tipped over the edge of its rim, on the table."""
    angle = math.radians(degrees)
    return SE3.at(0.45, 0.45, RADIUS * math.sin(angle) - 0.0001) @ SE3.about((1, 0, 0), angle)


ON_TABLE, TURNED = SE3.at(0.45, 0.45, -0.0001), SE3.about((1, 0, 0), math.pi)
BESIDE = SE3.at(x=RADIUS + CUBE_EDGE / 2 - 0.0003, z=CUBE_EDGE / 2 - 0.0001)
ON_RIM = SE3.at(x=RADIUS - WALL / 2, z=RIM_HEIGHT + CUBE_EDGE / 2 - 0.0002)
OVER_CUBE = ON_TABLE.moved(z=CUBE_EDGE + FLOOR - 0.0003) @ TURNED


@pytest.mark.parametrize(
    ("bowl", "cube", "partners", "counts"),
    [
        pytest.param(ON_TABLE, IN_BOWL, {"white_bowl"}, True, id="elsewhere"),
        pytest.param(tipped(15), IN_BOWL, {"white_bowl"}, True, id="tipped a little"),
        pytest.param(tipped(25), IN_BOWL, {"white_bowl"}, False, id="tipped"),
        pytest.param(tipped(90), IN_BOWL, {"white_bowl"}, False, id="on its side"),
        pytest.param(ON_TABLE.moved(z=0.1), IN_BOWL, {"white_bowl"}, False, id="in the air"),
        pytest.param(ON_TABLE.moved(z=-0.8094), IN_BOWL, {"white_bowl"}, False, id="on the floor"),
        pytest.param(OVER_CUBE, IN_BOWL, {"white_bowl", TABLE}, False, id="turned over the cube"),
        pytest.param(ON_TABLE, SE3.at(z=RIM_HEIGHT - 0.002), set(), False, id="cube in the air"),
        pytest.param(ON_TABLE, BESIDE, {"white_bowl", TABLE}, False, id="cube against the rim"),
        pytest.param(ON_TABLE, ON_RIM, {"white_bowl"}, False, id="cube on the rim"),
    ],
)
def test_only_a_cube_in_a_bowl_that_stands_on_the_table_counts(
    bench: TaskHarness, bowl: SE3, cube: SE3, partners: set[str], counts: bool
) -> None:
    bench.start(0)
    bench.put(white_bowl=bowl, white_cube=bowl @ cube)
    assert bench.sim.contacts.partners("white_cube") == partners
    assert lies(bench) == counts


def test_a_bowl_in_the_other_bowl_does_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    bowl = bench.sim.pose("black_bowl").moved(z=RIM_HEIGHT - 0.0001)
    bench.put(white_bowl=bowl, white_cube=bowl @ IN_BOWL)
    assert bench.sim.contacts.between("white_bowl", "black_bowl")
    assert not lies(bench)
