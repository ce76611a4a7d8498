import math

import numpy as np
import pytest

from duobench.experts.block_balance import lower, script
from duobench.experts.motion import Arms, Script, down, move, pick, release, together, wait
from duobench.scene.naming import TABLE
from duobench.sim.simulation import STILL_SPEED
from duobench.solids.blocks import block
from duobench.solids.solid import PLA_DENSITY, mass_properties, printable
from duobench.spatial import SE3
from duobench.tasks.block_balance import BEAM, BLOCK, BLOCKS, CUBE_EDGE, LEVEL, TASK, TIPPING
from duobench.types import SIDES, Side
from tests.stageplay import Stageplay

PLACE = 0.078
"""Distance of a block from the beam's middle, where the expert puts it."""
STEPS_TO_TAKE_BLOCKS = 200
"""Control steps in which the expert has laid the beam and taken both blocks."""
STILL_STEPS = 15
"""Half a second."""
ON_CUBE = CUBE_EDGE + BEAM[2] / 2 - 0.0001
ON_BEAM = CUBE_EDGE + BEAM[2] + BLOCK[2] / 2 - 0.0002
"""Heights at which beam and blocks are in contact with what carries them."""


@pytest.fixture(scope="module")
def bench() -> Stageplay:
    return Stageplay(TASK)


def _ready(bench: Stageplay) -> None:
    """An episode in which the beam lies on the cube and both arms hold a block."""
    bench.start(0)
    assert bench.run_for(script, STEPS_TO_TAKE_BLOCKS) == 3


def _hands_away(arms: Arms) -> Script:
    yield from release(arms, *SIDES)
    yield from move(arms, {side: arms.targets[side].moved(z=0.15) for side in SIDES})


def _bridge(bench: Stageplay) -> dict[str, SE3]:
    x, y, _ = bench.sim.position("cube")
    return {"cube": SE3.at(x, y, CUBE_EDGE / 2), "beam": SE3.at(x, y, ON_CUBE)}


def _ends(bench: Stageplay, place: float = PLACE) -> dict[str, SE3]:
    x, y, _ = bench.sim.position("cube")
    return {
        name: SE3.at(x, y + sign * place, ON_BEAM)
        for name, sign in zip(BLOCKS, (1, -1), strict=True)
    }


def _tilt(bench: Stageplay) -> float:
    return math.acos(min(1.0, float(bench.sim.rotation("beam")[2, 2])))


def test_the_expert_passes_the_stages_in_order(bench: Stageplay) -> None:
    for seed in (3, 17):
        bench.start(seed)
        assert bench.run_for(script, TASK.horizon) == 5
        assert sorted(set(bench.history)) == [0, 1, 2, 3, 4, 5]
        assert bench.history == sorted(bench.history)
        assert bench.hold(60) == 5
        assert bench.progress.final_holds


# --- the physics that makes it bimanual --------------------------------------------------------


@pytest.mark.parametrize("place", [PLACE, TIPPING + 0.002])
@pytest.mark.parametrize("name", BLOCKS)
def test_one_block_alone_tips_the_beam(bench: Stageplay, name: str, place: float) -> None:
    bench.start(0)
    bench.put(**_bridge(bench), **{name: _ends(bench, place)[name]})
    tilts = [_tilt(bench) for _ in range(30) if bench.hold(1) == 0]
    assert max(tilts) > LEVEL
    assert bench.sim.contacts.between(name, TABLE)


def test_both_blocks_together_balance(bench: Stageplay) -> None:
    bench.start(0)
    bench.put(**_bridge(bench), **_ends(bench))
    bench.hold(60)
    assert _tilt(bench) < math.radians(1.0)


# --- what must not count -----------------------------------------------------------------------


def test_a_balance_that_was_not_built_does_not_count(bench: Stageplay) -> None:
    bench.start(0)
    bench.put(**_bridge(bench), **_ends(bench))
    assert bench.hold(30) == 0


def test_a_balance_after_the_stages_before_counts_once_it_stood_still(bench: Stageplay) -> None:
    _ready(bench)
    bench.act(_hands_away)
    bench.history.clear()
    bench.put(**_bridge(bench), **_ends(bench))
    bench.hold(30)
    assert bench.history.index(5) == STILL_STEPS - 1
    assert bench.history[: STILL_STEPS - 1] == [4] * (STILL_STEPS - 1)


def _push(bench: Stageplay, name: str, speed: float) -> None:
    start = bench.sim.model.joint(name).dofadr[0]
    bench.sim.data.qvel[start] = speed


def test_a_balance_that_moves_now_and_then_does_not_count(bench: Stageplay) -> None:
    _ready(bench)
    bench.act(_hands_away)
    for name in ("left_block", "beam"):
        bench.put(**_bridge(bench), **_ends(bench))
        for _ in range(3):
            assert bench.hold(STILL_STEPS - 5) == 4
            _push(bench, name, STILL_SPEED + 0.01)
            assert bench.judge() == 4
            _push(bench, name, 0.0)


def test_a_balance_on_a_tilted_beam_does_not_count(bench: Stageplay) -> None:
    _ready(bench)
    bench.act(_hands_away)
    built = {**_bridge(bench), **_ends(bench)}
    bench.put(**built)
    turn = SE3.about((1, 0, 0), LEVEL + 0.02)
    middle = built["beam"]
    tilted = {name: middle @ turn @ middle.inverse() @ pose for name, pose in built.items()}
    for _ in range(2 * STILL_STEPS):
        bench.put(**{**tilted, "cube": built["cube"]})
        assert bench.sim.contacts.between("beam", "cube")
    assert bench.stage == 4


@pytest.mark.parametrize("place", [TIPPING - 0.002, 0.017])
def test_blocks_near_the_middle_of_the_beam_do_not_count(bench: Stageplay, place: float) -> None:
    _ready(bench)
    bench.act(_hands_away)
    bench.put(**_bridge(bench), **_ends(bench, place))
    assert bench.hold(30) == 3
    assert all(bench.sim.contacts.between(name, "beam") for name in BLOCKS)
    bench.put(**_bridge(bench), **_ends(bench, TIPPING + 0.002))
    assert bench.hold(30) == 5


def test_one_block_on_the_beam_does_not_count(bench: Stageplay) -> None:
    _ready(bench)
    bench.act(_hands_away)
    x, y, _ = bench.sim.position("cube")
    # In the middle it stays level, and still only one of two is there.
    bench.put(**_bridge(bench), left_block=SE3.at(x, y, ON_BEAM))
    assert bench.hold(40) == 3
    assert _tilt(bench) < LEVEL


def test_blocks_above_the_beam_or_on_a_beam_that_lies_elsewhere_do_not_count(
    bench: Stageplay,
) -> None:
    _ready(bench)
    bench.act(_hands_away)
    built = {**_bridge(bench), **_ends(bench)}
    above = {name: built[name].moved(z=0.005) for name in BLOCKS}
    down_to_table = {name: pose.moved(z=-CUBE_EDGE) for name, pose in built.items()}
    elsewhere = {**down_to_table, "cube": SE3.at(0.3, 0.0, CUBE_EDGE / 2)}
    for before in (3, 4):
        for poses in ({**built, **above}, elsewhere):
            for _ in range(STILL_STEPS + 1):
                bench.put(**poses)
            assert bench.stage == before
        bench.put(**built)
        assert bench.stage == 4


def test_blocks_that_stand_on_the_table_against_the_beam_do_not_count(bench: Stageplay) -> None:
    _ready(bench)
    bench.act(_hands_away)
    bridge = _bridge(bench)
    aside, up = (BEAM[0] + BLOCK[0]) / 2 - 0.0002, BLOCK[2] / 2 - ON_CUBE
    lean = {
        name: bridge["beam"] @ SE3.at(aside, y, up)
        for name, y in zip(BLOCKS, (0.08, -0.08), strict=True)
    }
    bench.put(**bridge, **lean)
    assert bench.sim.contacts.between("beam", "cube")
    assert all(bench.sim.contacts.partners(name) == {"beam", TABLE} for name in BLOCKS)
    assert bench.hold(30) == 3


def test_a_balance_held_by_a_gripper_does_not_count(bench: Stageplay) -> None:
    _ready(bench)

    def hold_on(arms: Arms) -> Script:
        yield from lower(arms)
        yield from wait(60)

    assert bench.act(hold_on) == 4
    assert bench.hold(30) == 4


def test_carrying_the_beam_over_the_cube_without_putting_it_down_is_stage_one(
    bench: Stageplay,
) -> None:
    bench.start(0)

    def carry(arms: Arms) -> Script:
        x, y, z = arms.sim.position("beam")
        yield from pick(arms, Side.RIGHT, down(x, y, z + 0.014, yaw=-math.pi / 2))
        x, y, _ = arms.sim.position("cube")
        yield from move(arms, {Side.RIGHT: down(x, y, 0.12, yaw=-math.pi / 2)})

    assert bench.act(carry) == 1


def test_blocks_taken_before_the_beam_lies_do_not_count(bench: Stageplay) -> None:
    bench.start(0)

    def take(arms: Arms, side: Side) -> Script:
        x, y, z = arms.sim.position(f"{side}_block")
        yield from pick(arms, side, down(x, y, z + 0.01))

    assert bench.act(lambda arms: together(*(take(arms, side) for side in SIDES))) == 0


# --- objects -----------------------------------------------------------------------------------


def test_the_parts_weigh_what_they_print() -> None:
    for size in (BEAM, BLOCK, (CUBE_EDGE,) * 3):
        solid = block(*size, (1.0, 1.0, 1.0, 1.0))
        assert mass_properties(solid).mass == pytest.approx(PLA_DENSITY * math.prod(size))
        assert np.ptp(printable(solid).vertices, axis=0) == pytest.approx(size)


def test_a_reset_leaves_everything_apart_and_at_rest(bench: Stageplay) -> None:
    for seed in range(10):
        layout = bench.start(seed)
        assert not bench.sim.contacts.deepest(0.0005)
        cube, beam = layout.poses["cube"], layout.poses["beam"]
        assert cube.translation[0] - beam.translation[0] >= 0.08
        before = {name: bench.sim.position(name).copy() for name in bench.sim.props}
        assert bench.hold(15) == 0
        for name, position in before.items():
            assert np.linalg.norm(bench.sim.position(name) - position) < 0.001
