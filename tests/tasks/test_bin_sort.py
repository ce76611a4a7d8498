import math
from collections.abc import Callable

import pytest

from duobench.experts.handling import pick_cube
from duobench.experts.motion import Arms, Script, down, move, release
from duobench.objects.blocks import CUBE_EDGE
from duobench.objects.bowl import FLOOR, RADIUS, RIM_HEIGHT, WALL
from duobench.scene.naming import TABLE
from duobench.spatial import SE3
from duobench.stages.placing import REST_SECONDS
from duobench.stages.vessels import Vessel
from duobench.types import CONTROL_HZ, SIDES, Side
from tests.predicate_probe import PredicateProbe
from tests.task_harness import TaskHarness

IN_BOWL = 0.004 + CUBE_EDGE / 2 + 0.0005
"""Height of a cube's centre above the underside of the bowl that it lies in, in metres."""


def _in(bench: TaskHarness, bowl: str) -> SE3:
    return bench.sim.pose(bowl) @ SE3.at(z=IN_BOWL)


BOWL = Vessel(body="white_bowl", radius=RADIUS - WALL, rim=RIM_HEIGHT, floor=FLOOR)
COLOUR = {Side.LEFT: "white", Side.RIGHT: "black"}
GRASP_HEIGHT = 0.028
IN_THE_BOWL = 0.027
"""Height of the tool that presses a cube on its bowl's floor, in metres."""
REST_STEPS = round(REST_SECONDS * CONTROL_HZ) + 1


def lies(bench: TaskHarness) -> bool:
    """Whether the white cube lies in the white bowl, whoever brought it."""
    return PredicateProbe(BOWL.holds("white_cube")).ask(bench.sim)


def bring(side: Side, height: float = IN_THE_BOWL) -> Callable[[Arms], Script]:
    """An arm picks up the cube on its side and brings it into its bowl, the tool at a height."""

    def run(arms: Arms) -> Script:
        yield from pick_cube(arms, side, f"{COLOUR[side]}_cube", GRASP_HEIGHT)
        x, y, _ = arms.sim.position(f"{COLOUR[side]}_bowl")
        yield from move(arms, {side: down(x, y, 0.12)})
        yield from move(arms, {side: down(x, y, height)}, speed=0.1)

    return run


def let_go(side: Side) -> Callable[[Arms], Script]:
    def run(arms: Arms) -> Script:
        yield from release(arms, side)
        yield from move(arms, {side: arms.targets[side].moved(z=0.1)})

    return run


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
    bench.put(white_cube=_in(bench, "white_bowl"), black_cube=_in(bench, "black_bowl"))
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
    for side, cube in ((Side.LEFT, "white_cube"), (Side.RIGHT, "black_cube")):
        bench.act(lambda arms, side=side, cube=cube: pick_cube(arms, side, cube, 0.028))
        assert bench.stage == (1 if side is Side.LEFT else 2)


@pytest.mark.parametrize("speed", [0.06, 0.5, 1.5])
@pytest.mark.parametrize("direction", [0, 2])
def test_a_cube_that_flies_through_its_bowl_does_not_count(
    bench: TaskHarness, speed: float, direction: int
) -> None:
    """It touches the bowl's floor, and moves."""
    bench.start(0)
    bench.sim.place("white_cube", _in(bench, "white_bowl").moved(z=-0.0007))
    bench.push("white_cube", speed, first=direction)
    assert bench.sim.contacts.between("white_cube", "white_bowl")
    assert not lies(bench)


def test_a_cube_that_spins_in_its_bowl_does_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    bench.sim.place("white_cube", _in(bench, "white_bowl").moved(z=-0.0007))
    bench.push("white_cube", 0.6, first=5)
    assert not lies(bench)


LYING = SE3.about((1, 0, 0), math.pi / 2)


@pytest.mark.parametrize(
    "bowl",
    [
        SE3.at(0.45, 0.45, 0.10),
        SE3.at(0.45, 0.45, -0.8094),
        SE3.at(0.45, 0.45, RADIUS - 0.0001) @ LYING,
        SE3.at(0.45, 0.45, RADIUS * math.sin(math.radians(25)) - 0.0001)
        @ SE3.about((1, 0, 0), math.radians(25)),
    ],
    ids=["in the air", "on the floor", "on its side", "tipped"],
)
def test_a_bowl_that_does_not_stand_on_the_table_does_not_count(
    bench: TaskHarness, bowl: SE3
) -> None:
    bench.start(0)
    for _ in range(3):
        bench.put(white_bowl=bowl, white_cube=bowl @ SE3.at(z=IN_BOWL - 0.0007))
        assert bench.sim.contacts.between("white_cube", "white_bowl")
        assert not lies(bench)


def test_a_bowl_that_stands_elsewhere_on_the_table_counts(bench: TaskHarness) -> None:
    bench.start(0)
    tilt = SE3.about((1, 0, 0), math.radians(15))
    bowl = SE3.at(0.45, 0.45, RADIUS * math.sin(math.radians(15)) - 0.0001) @ tilt
    bench.put(white_bowl=bowl, white_cube=bowl @ SE3.at(z=IN_BOWL - 0.0007))
    assert bench.sim.contacts.between("white_bowl", TABLE)
    assert lies(bench)


def test_a_bowl_in_the_other_bowl_does_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    bowl = bench.sim.pose("black_bowl").moved(z=RIM_HEIGHT - 0.0001)
    bench.put(white_bowl=bowl, white_cube=bowl @ SE3.at(z=IN_BOWL - 0.0007))
    assert bench.sim.contacts.between("white_bowl", "black_bowl")
    assert not lies(bench)


@pytest.mark.parametrize(
    ("x", "z"),
    [(0.0, RIM_HEIGHT - 0.002), (RADIUS + CUBE_EDGE / 2 - 0.0003, CUBE_EDGE / 2 - 0.0001)],
    ids=["in the air", "against the rim"],
)
def test_a_cube_in_the_air_or_beside_the_bowl_does_not_count(
    bench: TaskHarness, x: float, z: float
) -> None:
    bench.start(0)
    bench.put(white_cube=bench.sim.pose("white_bowl") @ SE3.at(x=x, z=z))
    beside = x > 0.0
    assert bench.sim.contacts.between("white_cube", "white_bowl") == beside
    assert not lies(bench)


def test_a_cube_on_the_rim_does_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    rim = SE3.at(x=RADIUS - WALL / 2, z=RIM_HEIGHT + CUBE_EDGE / 2 - 0.0002)
    bench.put(white_cube=bench.sim.pose("white_bowl") @ rim)
    assert bench.sim.contacts.partners("white_cube") == {"white_bowl"}
    assert not lies(bench)


def test_a_bowl_turned_over_a_cube_does_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    x, y, _ = bench.sim.position("white_bowl")
    cube = SE3.at(x, y, CUBE_EDGE / 2 - 0.0001)
    over = SE3.at(x, y, CUBE_EDGE + FLOOR - 0.0003) @ SE3.about((1, 0, 0), math.pi)
    bench.put(white_cube=cube, white_bowl=over)
    assert bench.sim.contacts.partners("white_cube") == {"white_bowl", TABLE}
    assert not lies(bench)
