import math

import numpy as np
import pytest

from duobench.experts.handover import Bar, clasp, let_go, pick_bar
from duobench.experts.motion import Arms, Script, down, pick, wait
from duobench.experts.transfer_cube import BAR, MEETING_POINT, script
from duobench.sim.layout import Layout
from duobench.sim.simulation import STILL_SPEED
from duobench.solids.blocks import CUBE_EDGE, LONG_BLOCK
from duobench.solids.bowl import FLOOR, RADIUS, RIM_HEIGHT
from duobench.solids.solid import PLA_DENSITY
from duobench.spatial import SE3
from duobench.tasks.transfer_cube import TASK
from duobench.types import SIDES, Side
from tests.handovers import bring, drop, meet
from tests.stageplay import Stageplay

LEFT, RIGHT = Side.LEFT, Side.RIGHT
BOWL = np.array([0.55, 0.15, 0.0])
"""Where both arms reach into the bowl."""
IN_BOWL = np.array([0.55, 0.15, 0.045])
BOTH_REACH = Layout(
    poses={"cube": SE3.at(0.45, -0.18, CUBE_EDGE / 2, yaw=0.3), "bowl": SE3.at(*BOWL)}
)
LYING = SE3.at(z=FLOOR + CUBE_EDGE / 2)
STANDING = SE3.at(z=FLOOR + LONG_BLOCK / 2) @ SE3.about((0, 1, 0), math.pi / 2)
BESIDE = SE3.at(x=-RADIUS - 0.0155, z=LONG_BLOCK / 2) @ SE3.about((0, 1, 0), math.pi / 2)
"""Standing on the table, against the rim."""
ON_RIM = SE3.at(x=RADIUS - 0.001, z=RIM_HEIGHT + CUBE_EDGE / 2 - 0.0005)
ACROSS_RIM = SE3.at(x=0.073, z=RIM_HEIGHT + CUBE_EDGE / 2 - 0.0002, yaw=math.pi / 2)
"""Lying on top of the rim by both ends."""


@pytest.fixture(scope="module")
def bench() -> Stageplay:
    return Stageplay(TASK)


@pytest.fixture
def table(bench: Stageplay) -> Stageplay:
    bench.start(layout=BOTH_REACH)
    return bench


def both_hold(arms: Arms) -> Script:
    yield from meet(arms, BAR, MEETING_POINT, grip_at=0.022, slant=0.5)


def hand_over(arms: Arms) -> Script:
    yield from both_hold(arms)
    yield from let_go(arms, RIGHT)


def hand_over_and_bring(arms: Arms) -> Script:
    yield from hand_over(arms)
    yield from bring(arms, LEFT, "cube", BOWL + np.array([0.0, 0.0, 0.15]))


def into_bowl(arms: Arms, side: Side) -> Script:
    yield from bring(arms, side, "cube", IN_BOWL)
    yield from drop(arms, side)


def in_bowl(bench: Stageplay) -> bool:
    """Whether the cube ended up in the bowl, so that a refused stage says something."""
    offset = bench.sim.position("cube") - bench.sim.position("bowl")
    touching = bench.sim.contacts.partners("cube")
    return bool(np.hypot(*offset[:2]) < RADIUS) and "bowl" in touching and "table" not in touching


@pytest.mark.parametrize("seed", [3, 17])
def test_the_expert_passes_the_stages_in_order(bench: Stageplay, seed: int) -> None:
    bench.start(seed)
    assert bench.run_for(script, TASK.horizon) == 4
    assert bench.history == sorted(bench.history)
    assert set(bench.history) == {0, 1, 2, 3, 4}
    assert bench.progress.final_holds
    assert in_bowl(bench)


# --- what must not count -------------------------------------------------------------------------


def test_a_cube_that_was_pushed_into_the_bowl_does_not_count(table: Stageplay) -> None:
    table.put(cube=table.sim.pose("bowl") @ LYING)
    assert table.hold(20) == 0
    assert in_bowl(table)


def test_a_cube_that_was_thrown_into_the_bowl_does_not_count(table: Stageplay) -> None:
    assert table.act(lambda arms: pick_bar(arms, BAR)) == 1
    table.act(lambda arms: drop(arms, RIGHT))
    table.put(cube=table.sim.pose("bowl") @ LYING)
    assert table.hold(20) == 1
    assert in_bowl(table)


def test_the_arm_that_picked_it_up_may_not_put_it_into_the_bowl(table: Stageplay) -> None:
    def alone(arms: Arms) -> Script:
        yield from pick_bar(arms, BAR)
        yield from into_bowl(arms, RIGHT)

    assert table.act(alone) == 1
    assert in_bowl(table)


def test_an_arm_that_takes_part_and_lets_go_again_has_not_received(table: Stageplay) -> None:
    def keep(arms: Arms) -> Script:
        yield from both_hold(arms)
        yield from let_go(arms, LEFT)
        yield from into_bowl(arms, RIGHT)

    assert table.act(keep) == 2
    assert in_bowl(table)


def test_a_cube_that_was_handed_back_does_not_count(table: Stageplay) -> None:
    def back(arms: Arms) -> Script:
        yield from both_hold(arms)
        held_here = arms.targets[RIGHT]
        yield from let_go(arms, RIGHT)
        yield from clasp(arms, RIGHT, held_here)
        yield from let_go(arms, LEFT)
        yield from into_bowl(arms, RIGHT)

    assert table.act(back) == 3
    assert in_bowl(table)


def test_putting_it_down_for_the_other_arm_is_no_handover(table: Stageplay) -> None:
    middle = np.array([0.45, 0.0, CUBE_EDGE / 2 + 0.002])

    def by_table(arms: Arms) -> Script:
        yield from pick_bar(arms, BAR)
        yield from bring(arms, RIGHT, "cube", middle)
        yield from drop(arms, RIGHT)
        yield from pick_bar(arms, Bar(body="cube", giver=LEFT, grip=0.026, height=0.028))
        yield from into_bowl(arms, LEFT)

    assert table.act(by_table) == 1
    assert in_bowl(table)


def test_a_handover_that_ends_on_the_table_is_none(table: Stageplay) -> None:
    def fumble(arms: Arms) -> Script:
        yield from both_hold(arms)
        yield from drop(arms, *SIDES)
        x, y, z = arms.sim.position("cube")
        cube = arms.sim.rotation("cube")
        along = cube[:, 0] if abs(cube[2, 0]) < 0.5 else cube[:, 1]
        yaw = math.atan2(along[1], along[0])
        yield from pick(arms, LEFT, down(x, y, z + 0.012, yaw=yaw))
        yield from into_bowl(arms, LEFT)

    assert table.act(fumble) == 2
    assert in_bowl(table)


def test_a_catch_is_no_handover(table: Stageplay) -> None:
    assert table.act(hand_over) == 3
    caught = table.sim.save()
    table.start(layout=BOTH_REACH)
    assert table.act(lambda arms: pick_bar(arms, BAR)) == 1
    table.sim.restore(caught)
    assert table.judge() == 1
    assert table.sim.contacts.pads(LEFT, "cube")


def test_a_cube_that_is_still_held_in_the_bowl_does_not_count(table: Stageplay) -> None:
    def hold_on(arms: Arms) -> Script:
        yield from hand_over(arms)
        yield from bring(arms, LEFT, "cube", IN_BOWL - (0, 0, 0.012))
        yield from wait(30)

    assert table.act(hold_on) == 3
    assert in_bowl(table)
    assert max(table.sim.speed("cube")) < STILL_SPEED
    assert table.act(lambda arms: drop(arms, LEFT)) == 4


@pytest.mark.parametrize("place", [LYING, LYING.moved(z=0.10)], ids=["pushed", "thrown"])
def test_a_handover_does_not_excuse_pushing_or_throwing(table: Stageplay, place: SE3) -> None:
    assert table.act(hand_over) == 3
    table.act(lambda arms: drop(arms, LEFT))
    table.put(cube=table.sim.pose("bowl") @ place)
    assert table.hold(30) == 3
    assert in_bowl(table)


@pytest.mark.parametrize("pose", [LYING, STANDING], ids=["lying", "standing"])
def test_a_cube_that_was_handed_over_and_brought_counts_in_the_bowl(
    table: Stageplay, pose: SE3
) -> None:
    assert table.act(hand_over_and_bring) == 3
    table.put(cube=table.sim.pose("bowl") @ ACROSS_RIM)
    assert table.sim.contacts.partners("cube") == {"bowl"}
    assert table.hold(10) == 3
    table.put(cube=table.sim.pose("bowl") @ pose.moved(z=0.002))
    assert table.stage == 3
    assert table.hold(10) == 4


@pytest.mark.parametrize("elsewhere", [BESIDE, ON_RIM], ids=["beside", "on the rim"])
def test_a_cube_that_left_the_bowl_again_does_not_count(table: Stageplay, elsewhere: SE3) -> None:
    table.act(hand_over_and_bring)
    table.put(cube=table.sim.pose("bowl") @ elsewhere)
    assert table.stage == 3
    table.put(cube=table.sim.pose("bowl") @ LYING)
    assert table.hold(10) == 3
    assert in_bowl(table)


# --- objects -------------------------------------------------------------------------------------


def test_the_cube_weighs_what_it_is_made_of(bench: Stageplay) -> None:
    mass = bench.sim.model.body("cube").mass[0]
    assert mass == pytest.approx(LONG_BLOCK * CUBE_EDGE**2 * PLA_DENSITY)


@pytest.mark.parametrize("seed", range(10))
def test_objects_rest_apart_at_reset(bench: Stageplay, seed: int) -> None:
    layout = bench.start(seed)
    assert bench.sim.contacts.deepest(0.0005) == []
    for name in ("cube", "bowl"):
        assert bench.sim.contacts.partners(name) == {"table"}
        moved, turned = bench.sim.pose(name).distance(layout.poses[name])
        assert moved < 0.001
        assert turned < 0.01
    assert bench.hold(10) == 0
    assert max(bench.sim.speed("cube")) < 0.005
    assert bench.sim.position("cube")[1] < 0 < bench.sim.position("bowl")[1]
