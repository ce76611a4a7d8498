import math

import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.tasks.block_balance import (
    BEAM,
    BLOCK,
    BLOCKS,
    CUBE_EDGE,
    LEVEL_DEGREES,
    STANDING_DEGREES,
    TIPPING,
)
from duobench.tasks.experts.handling import pick
from duobench.tasks.experts.motion import Arms, Script, down, move, together, wait_until
from duobench.tasks.experts.scripts.block_balance import lower, script
from duobench.tasks.stages.coordination import TOGETHER_SECONDS
from duobench.tasks.stages.placing import REST_SECONDS
from duobench.tasks.stages.predicates import STILL_SPEED
from duobench.world.scene.naming import TABLE
from tests.task_harness import TaskHarness

PLACE = 0.078
"""Distance of a block from the beam's middle, where the expert puts it."""
REST_STEPS = round(REST_SECONDS * CONTROL_HZ)
ON_CUBE = CUBE_EDGE + BEAM[2] / 2 - 0.0001
ON_BEAM = CUBE_EDGE + BEAM[2] + BLOCK[2] / 2 - 0.0002
"""Heights at which beam and blocks are in contact with what carries them."""
HOVER = 0.05
"""How far above the beam blocks wait, in metres: from there they would be dropped."""
ASIDE = SE3.at(0.3, -0.3, BLOCK[2] / 2)
"""A place on the table."""


def _ready(bench: TaskHarness) -> None:
    """An episode in which the beam lies on the cube and both arms hold a block in the air."""
    bench.start(0)
    bench.reach(script, 3)
    bench.act(lambda arms: move(arms, {side: arms.targets[side].moved(z=0.12) for side in SIDES}))
    assert bench.stage == 3


def _loaded(bench: TaskHarness) -> None:
    """An episode in which both arms hold their blocks on the beam."""
    bench.start(0)
    bench.reach(script, 4)


def _build(bench: TaskHarness, **poses: SE3) -> None:
    """Build a state without hands: the arms are at home."""
    here = {name: bench.sim.pose(name) for name in bench.sim.props}
    bench.sim.reset_data()
    bench.put(**{**here, **poses})


def _built(bench: TaskHarness, place: float = PLACE) -> dict[str, SE3]:
    """Poses with the beam on the cube, and a block on each of its ends, at a distance."""
    x, y, _ = bench.sim.position("cube")
    blocks = {
        name: SE3.at(x, y + end, ON_BEAM) for name, end in zip(BLOCKS, (place, -place), strict=True)
    }
    return {"cube": SE3.at(x, y, CUBE_EDGE / 2), "beam": SE3.at(x, y, ON_CUBE), **blocks}


def _tilt(bench: TaskHarness) -> float:
    return math.acos(min(1.0, float(bench.sim.rotation("beam")[2, 2])))


@pytest.mark.parametrize(
    ("name", "place", "off"),
    [
        *(
            (name, place, 0.0)
            for name in BLOCKS
            for place in (0.070, PLACE, TIPPING + 0.002, 0.084)
        ),
        *(("left_block", place, 0.010) for place in (0.070, 0.077, 0.084)),
    ],
)
def test_one_block_alone_tips_a_beam_that_lies_in_the_middle(
    bench: TaskHarness, name: str, place: float, off: float
) -> None:
    """Off the middle it does not: therefore the rule asks for both at once, and not the physics."""
    bench.start(0)
    built = _built(bench, place)
    moved = {part: built[part].moved(y=-off) for part in ("beam", name)}
    bench.put(cube=built["cube"], **moved)
    tilts = [_tilt(bench) for _ in range(90) if bench.hold(1) == 0]
    assert (max(tilts) > math.radians(LEVEL_DEGREES)) == (off == 0.0)
    assert bench.sim.contacts.between(name, TABLE) == (off == 0.0)
    assert off == 0.0 or bench.sim.contacts.between(name, "beam")


def test_a_balance_of_both_counts_once_it_stood_still(bench: TaskHarness) -> None:
    _loaded(bench)
    bench.history.clear()
    _build(bench, **_built(bench))
    bench.hold(30)
    assert bench.history.index(5) == REST_STEPS - 1
    assert bench.history[: REST_STEPS - 1] == [4] * (REST_STEPS - 1)


@pytest.mark.parametrize("name", ["left_block", "beam", "cube"])
def test_a_balance_that_moves_now_and_then_does_not_count(bench: TaskHarness, name: str) -> None:
    _loaded(bench)
    _build(bench, **_built(bench))
    for _ in range(3):
        bench.put(**_built(bench))
        assert bench.hold(REST_STEPS - 5) == 4
        bench.push(name, STILL_SPEED + 0.01)
        assert bench.judge() == 4
        bench.push(name, 0.0)


@pytest.mark.parametrize(("beyond", "stage"), [(0.02, 4), (-0.02, 5)])
def test_a_balance_on_a_tilted_beam_does_not_count(
    bench: TaskHarness, beyond: float, stage: int
) -> None:
    _loaded(bench)
    built = _built(bench)
    middle = built["beam"]
    turn = middle @ SE3.about((1, 0, 0), math.radians(LEVEL_DEGREES) + beyond) @ middle.inverse()
    tilted = {name: turn @ pose for name, pose in built.items()} | {"cube": built["cube"]}
    for _ in range(2 * REST_STEPS):
        _build(bench, **tilted)
        assert bench.sim.contacts.between("beam", "cube")
    assert bench.stage == stage


def test_blocks_that_do_not_stand_do_not_count(bench: TaskHarness) -> None:
    _loaded(bench)
    built = _built(bench)
    lying = SE3.at(z=(BLOCK[0] - BLOCK[2]) / 2) @ SE3.about((0, 1, 0), math.pi / 2)
    leaning = SE3.about((0, 1, 0), math.radians(STANDING_DEGREES) + 0.02)
    for fallen, physics in ((lying, True), (leaning, False)):
        poses = built | {"left_block": built["left_block"] @ fallen}
        for _ in range(2 * REST_STEPS):
            _build(bench, **poses)
        if physics:
            bench.hold(2 * REST_STEPS)
        assert bench.sim.contacts.between("left_block", "beam")
        assert bench.stage == 4
    _build(bench, **built)
    assert bench.hold(30) == 5


def test_a_balance_that_an_arm_touches_does_not_count(bench: TaskHarness) -> None:
    """Not with its gripper: all that is built is brought to its elbow."""
    _loaded(bench)
    built = _built(bench)
    bench.sim.reset_data()
    bench.sim.forward()
    elbow = bench.sim.position("left/link4") - built["left_block"].translation
    for shift, stage in ((elbow, 4), (np.zeros(3), 5)):
        x, y, z = shift
        for _ in range(REST_STEPS):
            _build(bench, **{name: pose.moved(x=x, y=y, z=z) for name, pose in built.items()})
            assert bench.sim.contacts.arm(Side.LEFT, "left_block") == (stage == 4)
            assert not bench.sim.contacts.gripper(Side.LEFT, "left_block")
        assert bench.stage == stage


@pytest.mark.parametrize("place", [TIPPING - 0.002, 0.017])
def test_blocks_near_the_middle_of_the_beam_do_not_count(bench: TaskHarness, place: float) -> None:
    _loaded(bench)
    _build(bench, **_built(bench, place))
    assert bench.hold(30) == 4
    assert all(bench.sim.contacts.between(name, "beam") for name in BLOCKS)
    _build(bench, **_built(bench, TIPPING + 0.002))
    assert bench.hold(30) == 5


@pytest.mark.parametrize(("reach", "stage"), [(0.05, 3), (0.07, 4)])
def test_both_put_their_blocks_onto_the_ends(bench: TaskHarness, reach: float, stage: int) -> None:
    _ready(bench)
    assert bench.act(lambda arms: lower(arms, reach=reach)) == stage
    assert all(bench.sim.contacts.between(name, "beam") for name in BLOCKS)


def _hover(bench: TaskHarness) -> None:
    """Both blocks are in hand, higher above the beam than they may be let go."""
    _ready(bench)
    assert bench.act(lambda arms: lower(arms, gap=HOVER)) == 3


def _land(bench: TaskHarness, side: Side) -> int:
    """The stage after a block went straight down onto the beam, in hand."""

    def script(arms: Arms) -> Script:
        yield from move(arms, {side: arms.targets[side].moved(z=-HOVER - 0.008)}, speed=0.1)
        yield from wait_until(landed, 10)

    def landed() -> bool:
        return bench.sim.contacts.between(f"{side}_block", "beam")

    stage = bench.act(script)
    assert landed()
    return stage


@pytest.mark.parametrize(("seconds", "stage"), [(0.0, 4), (0.7, 4), (TOGETHER_SECONDS, 3)])
def test_one_block_on_the_beam_does_not_count(
    bench: TaskHarness, seconds: float, stage: int
) -> None:
    _hover(bench)
    bench.progress.explain()
    assert _land(bench, Side.LEFT) == 3
    # It counts when the other one comes soon, while it is still in hand.
    bench.hold(round(seconds * CONTROL_HZ))
    assert _land(bench, Side.RIGHT) == stage
    if stage == 3:
        assert any("left_block is there before right_block" in why for why in bench.progress.unmet)


def test_a_block_beside_the_ends_is_told_of_by_the_end(bench: TaskHarness) -> None:
    _ready(bench)
    bench.progress.explain()
    assert bench.act(lambda arms: lower(arms, reach=0.058)) == 3
    assert "no block is at an end of beam, 60 mm from its middle at least" in bench.progress.unmet


def test_a_balance_that_a_block_has_left_does_not_count(bench: TaskHarness) -> None:
    _loaded(bench)
    x, y, _ = bench.sim.position("cube")
    # One block in the middle stays level; the other one is back on the table.
    off = {"left_block": SE3.at(x, y, ON_BEAM), "right_block": ASIDE}
    _build(bench, **_built(bench) | off)
    assert bench.hold(40) == 4
    assert _tilt(bench) < math.radians(LEVEL_DEGREES)
    _build(bench, **_built(bench))
    assert bench.hold(30) == 4


@pytest.mark.parametrize(("steps", "stage"), [(2, 4), (3, 3)])
def test_a_block_that_was_let_go_on_the_beam_does_not_count(
    bench: TaskHarness, steps: int, stage: int
) -> None:
    """And a contact that flickers was not let go."""
    _hover(bench)
    _land(bench, Side.LEFT)
    held = bench.sim.get_state()
    _build(bench)
    for _ in range(steps - 1):
        bench.judge()
    bench.sim.set_state(held)
    bench.judge()
    assert bench.sim.contacts.grasped(Side.LEFT, "left_block")
    assert _land(bench, Side.RIGHT) == stage


def test_blocks_above_the_beam_or_on_a_beam_that_lies_elsewhere_do_not_count(
    bench: TaskHarness,
) -> None:
    built = _built(bench)
    above = {name: built[name].moved(z=0.005) for name in BLOCKS}
    down_to_table = {name: pose.moved(z=-CUBE_EDGE) for name, pose in built.items()}
    elsewhere = {**down_to_table, "cube": SE3.at(0.3, 0.0, CUBE_EDGE / 2)}
    for poses in ({**built, **above}, elsewhere):
        _loaded(bench)
        for _ in range(REST_STEPS + 1):
            _build(bench, **poses)
        assert bench.stage == 4


def test_blocks_that_stand_on_the_table_against_the_beam_do_not_count(bench: TaskHarness) -> None:
    _loaded(bench)
    built = _built(bench)
    aside, up = (BEAM[0] + BLOCK[0]) / 2 - 0.0002, BLOCK[2] / 2 - ON_CUBE
    lean = {
        name: built["beam"] @ SE3.at(aside, y, up)
        for name, y in zip(BLOCKS, (0.08, -0.08), strict=True)
    }
    _build(bench, **built | lean)
    assert bench.sim.contacts.between("beam", "cube")
    assert all(bench.sim.contacts.partners(name) == {"beam", TABLE} for name in BLOCKS)
    assert bench.hold(30) == 4
    # And what stood on the table has left the beam.
    _build(bench, **built)
    assert bench.hold(30) == 4


def test_blocks_taken_before_the_beam_lies_do_not_count(bench: TaskHarness) -> None:
    bench.start(0)

    def take(arms: Arms, side: Side) -> Script:
        x, y, z = arms.sim.position(f"{side}_block")
        yield from pick(arms, side, down(x, y, z + 0.01))

    assert bench.act(lambda arms: together(*(take(arms, side) for side in SIDES))) == 0
