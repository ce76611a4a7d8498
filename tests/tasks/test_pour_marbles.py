import math

import pytest

from duobench.core.errors import TaskError
from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.tasks.experts.motion import Arms, Script, move, release, together
from duobench.tasks.experts.scripts.pour_marbles import script, take
from duobench.tasks.pour_marbles import CUPS, MARBLES, SQUARES, TASK
from duobench.tasks.stages.placing import REST_SECONDS
from duobench.tasks.stages.pouring import pouring
from duobench.tasks.stages.predicates import upright
from duobench.world.objects.cup import HEAP, HEIGHT, MARBLE_RADIUS, OUTER_RADIUS, WALL
from duobench.world.sim.contacts import Limb, limb_owner
from tests.steps import Act, back, do
from tests.task_harness import TaskHarness
from tests.ways.pour_marbles import Pouring, done, marbles_in, pour_with

IN_CUP = SE3.at(z=0.001)
BESIDE_CUP = SE3.at(x=OUTER_RADIUS + MARBLE_RADIUS, z=MARBLE_RADIUS)
OVER_RIM = SE3.at(z=HEIGHT + 0.001)
BELOW_RIM = SE3.at(z=HEIGHT - MARBLE_RADIUS)
NEAR_FLOOR = SE3.at(z=WALL + 2 * MARBLE_RADIUS)
REST_STEPS = round(REST_SECONDS * CONTROL_HZ) + 1
SUNK = SE3.at(z=-0.0001)
"""As deep as things stand in the table."""


def take_both(arms: Arms) -> Script:
    yield from together(*(take(arms, side) for side in SIDES))


def lower_both(arms: Arms) -> Script:
    yield from move(arms, {side: arms.targets[side].moved(z=-0.06) for side in SIDES})


def test_pouring_asks_for_something_to_pour() -> None:
    with pytest.raises(TaskError, match="Nothing is poured into 'left_cup': name one thing"):
        pouring([], "left_cup", (0.03, 0.0, 0.1), held=upright("right_cup", 0.1))


def _sides(bench: TaskHarness, seed: int) -> tuple[Side, Side]:
    """Source and target of a seed."""
    full = Side(bench.start(seed).variants["full"])
    return full, full.other


def _lifted(bench: TaskHarness) -> tuple[Side, Side]:
    """An episode in which both arms have lifted their cups and have not poured yet."""
    sides = _sides(bench, 0)
    bench.reach(script, 3)
    bench.hold(10)
    return sides


def _marbles(base: SE3) -> dict[str, SE3]:
    return {name: base @ SE3.at(*at) for name, at in zip(MARBLES, HEAP, strict=True)}


def _home(bench: TaskHarness) -> dict[str, SE3]:
    return {CUPS[side]: SE3.at(*bench.sim.position(SQUARES[side])) @ SUNK for side in SIDES}


def _with_marbles(cups: dict[str, SE3], side: Side) -> dict[str, SE3]:
    return {**cups, **_marbles(cups[CUPS[side]] @ IN_CUP)}


def _into(bench: TaskHarness, side: Side) -> dict[str, SE3]:
    """Marbles that lie in a cup where it is now."""
    return _marbles(bench.sim.pose(CUPS[side]) @ IN_CUP)


def _put_moving(bench: TaskHarness, speed: float, prop: str, pose: SE3) -> int:
    """Build a state in which a prop moves, upwards where the speed is positive."""
    bench.sim.place(prop, pose)
    bench.push(prop, speed, first=2)
    return bench.judge()


@pytest.mark.long
@pytest.mark.parametrize("source", SIDES)
def test_the_expert_pours_either_way(bench: TaskHarness, source: Side) -> None:
    seed = next(s for s in range(50) if next(TASK.layouts(s)).variants["full"] == source)
    assert _sides(bench, seed)[0] is source
    partners = bench.sim.contacts.partners
    touched: set[tuple[str, str]] = set()
    for stage in bench.steps(script, then=TASK.horizon):
        touched.update((name, owner) for name in CUPS.values() for owner in partners(name))
        if stage == 6:
            break
    assert len(bench.history) <= TASK.horizon
    assert bench.history == sorted(bench.history)
    assert {3, 4, 5, 6} <= set(bench.history)
    # The pads of its own hand are all that a cup may touch of the robot: no camera, no linkage.
    pads = (Limb.LEFT_FINGER, Limb.RIGHT_FINGER)
    grasps = {(CUPS[side], limb_owner(side, pad)) for side in SIDES for pad in pads}
    limbs = {limb_owner(side, limb) for side in SIDES for limb in Limb}
    assert {(name, owner) for name, owner in touched if owner in limbs} == grasps


def test_the_instruction_names_source_and_target(bench: TaskHarness) -> None:
    full, empty = _sides(bench, 0)
    text = TASK.instruct(bench.start(0))
    assert f"from the {full} cup into the {empty} cup" in text


def _afresh(bench: TaskHarness) -> dict[str, SE3]:
    """Both cups in the grippers, in an episode that has seen nothing of it: their poses."""
    layout = bench.start(0)
    bench.reach(script, 3)
    bench.hold(10)
    bench.progress.reset(bench.sim, layout.variants)
    return {CUPS[side]: bench.sim.pose(CUPS[side]) for side in SIDES}


def test_a_cup_in_the_gripper_of_the_other_arm_does_not_count(bench: TaskHarness) -> None:
    left, right = _afresh(bench).values()
    bench.put(left_cup=right, right_cup=left)
    assert all(bench.sim.contacts.grasped(side, CUPS[side.other]) for side in SIDES)
    assert bench.stage == 0
    bench.put(left_cup=left, right_cup=SE3.at(0.5, -0.3))
    assert bench.stage == 1
    bench.put(right_cup=right)
    assert bench.stage == 2


def test_both_cups_count_as_lifted_from_20_mm_on(bench: TaskHarness) -> None:
    held = _afresh(bench)
    bench.put(**{name: pose.moved(x=-0.2, z=0.025) for name, pose in held.items()})
    assert bench.stage == 0
    for left, right, stage in ((15, 15, 2), (25, 15, 2), (15, 25, 2), (25, 25, 3)):
        # The cups slide up between the pads: the grippers hold them all the time.
        heights = zip(held.items(), (left, right), strict=True)
        bench.put(**{name: pose.moved(z=mm / 1000) for (name, pose), mm in heights})
        assert all(bench.sim.contacts.grasped(side, CUPS[side]) for side in SIDES)
        assert bench.stage == stage


@pytest.mark.parametrize("outside", [BESIDE_CUP, OVER_RIM, BELOW_RIM])
def test_marbles_beside_and_above_the_target_do_not_count(bench: TaskHarness, outside: SE3) -> None:
    _, target = _lifted(bench)
    stray = bench.sim.pose(CUPS[target]) @ outside
    column = {name: stray.moved(z=0.011 * k) for k, name in enumerate(MARBLES)}
    for inside, stage in ((0, 3), (1, 4), (len(MARBLES) - 1, 4), (len(MARBLES), 5)):
        rest = {name: column[name] for name in MARBLES[inside:]}
        bench.put(**{**_into(bench, target), **rest})
        assert bench.stage == stage


def test_a_marble_in_the_air_between_the_walls_does_not_count(bench: TaskHarness) -> None:
    _, target = _lifted(bench)
    above = bench.sim.pose(CUPS[target]) @ NEAR_FLOOR
    for speed, stage in ((-1.0, 3), (0.0, 4)):
        assert _put_moving(bench, speed, MARBLES[0], above) == stage


@pytest.mark.parametrize(("degrees", "stage"), [(35, 5), (55, 3), (90, 3)])
def test_marbles_in_a_cup_on_its_side_do_not_count(
    bench: TaskHarness, degrees: float, stage: int
) -> None:
    _, target = _lifted(bench)
    tool = bench.arms.targets[target].moved(z=0.1)
    turn = SE3.about(tool.rotation[:, 1], math.radians(degrees))
    turned = SE3(turn.rotation @ tool.rotation, tool.translation)
    bench.act(lambda arms: move(arms, {target: turned}, turn_speed=1.0))
    bench.put(**_into(bench, target))
    assert bench.stage == stage


@pytest.mark.parametrize("side", SIDES)
def test_marbles_count_only_while_both_cups_are_held_up(bench: TaskHarness, side: Side) -> None:
    _, target = _lifted(bench)
    held = {name: bench.sim.pose(name) for name in CUPS.values()}
    moved = {**held, CUPS[side]: held[CUPS[side]].moved(x=-0.2)}
    for cups, stage in ((moved, 3), (held, 5)):
        bench.put(**_with_marbles(cups, target))
        assert bench.stage == stage


def test_a_target_that_stood_with_marbles_must_be_emptied_first(bench: TaskHarness) -> None:
    source, target = _lifted(bench)
    held, filled = bench.sim.pose(CUPS[target]), _into(bench, target)
    bench.put(**_with_marbles({CUPS[target]: _home(bench)[CUPS[target]]}, target))
    bench.put(**{CUPS[target]: held, **filled})
    assert bench.stage == 3
    for marbles in (_into(bench, source), filled):
        bench.put(**marbles)
    assert bench.stage == 5


def _let_go(bench: TaskHarness) -> Side:
    """An episode after both cups were let go on the table, beside their squares: the target."""
    _, target = _sides(bench, 1)
    assert bench.act(take_both) == 3
    bench.put(**_into(bench, target))
    bench.act(lower_both)

    def released() -> bool:
        return not any(bench.sim.contacts.gripper(side, CUPS[side]) for side in SIDES)

    bench.run_until(do((release, *SIDES)), released)
    away = {side: pose @ SE3.at(z=-0.1) for side, pose in bench.arms.targets.items()}
    bench.act(lambda arms: move(arms, away))
    aside = {name: pose.moved(x=0.07) for name, pose in _home(bench).items()}
    bench.put(**_with_marbles(aside, target))
    assert bench.stage == 5
    return target


def _rest(bench: TaskHarness, speed: float = 0.0, **poses: SE3) -> int:
    """Keep props at poses until they would count, the first one moving upwards."""
    moving, pose = next(iter(poses.items()))
    for _ in range(REST_STEPS):
        for name, other in poses.items():
            bench.sim.place(name, other)
        _put_moving(bench, speed, moving, pose)
    return bench.stage


@pytest.mark.parametrize("side", SIDES)
def test_full_marks_need_both_cups_upright_at_home_and_still(
    bench: TaskHarness, side: Side
) -> None:
    target = _let_go(bench)
    home, cup = _home(bench), CUPS[side]
    tilt = SE3.about((1, 0, 0), math.radians(25))
    for change in (tilt, SE3.at(x=0.06), SE3.at(y=-0.06)):
        cups = {cup: home[cup] @ change, CUPS[side.other]: home[CUPS[side.other]]}
        assert _rest(bench, **_with_marbles(cups, target)) == 5
    cups = {cup: home[cup], CUPS[side.other]: home[CUPS[side.other]]}
    for speed, stage in ((0.1, 5), (0.0, 6)):
        assert _rest(bench, speed, **_with_marbles(cups, target)) == stage


@pytest.mark.parametrize("side", SIDES)
def test_a_cup_that_was_in_the_air_is_put_down_again(bench: TaskHarness, side: Side) -> None:
    target = _let_go(bench)
    home, cup = _home(bench), CUPS[side]
    bench.put(**_with_marbles({**home, cup: home[cup].moved(z=0.02)}, target))
    assert _rest(bench, **_with_marbles(home, target)) == 5


@pytest.mark.long
def test_cups_that_are_let_go_high_above_the_table_do_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    bench.act(lambda arms: pour_with(arms, Pouring(drop=0.020)))
    bench.hold(REST_STEPS + 10)
    assert done(bench.sim)
    assert bench.stage == 5


def test_full_marks_need_every_marble_to_stay_in_the_target(bench: TaskHarness) -> None:
    target = _let_go(bench)
    home = _home(bench)
    poured, outside = _with_marbles(home, target), home[CUPS[target]] @ BESIDE_CUP
    for last in (outside, poured[MARBLES[-1]]):
        assert _rest(bench, **{**poured, MARBLES[-1]: last}) == 5


@pytest.mark.parametrize("side", SIDES)
def test_full_marks_need_both_cups_released(bench: TaskHarness, side: Side) -> None:
    _, target = _sides(bench, 1)

    def leave(side: Side) -> Act:
        return do((release, side), (back, side, 0.1))

    assert bench.act(take_both) == 3
    bench.put(**_into(bench, target))
    assert bench.stage == 5
    assert bench.act(do(lower_both, leave(side.other))) == 5
    assert bench.hold(REST_STEPS) == 5
    bench.act(leave(side))
    assert bench.hold(REST_STEPS) == 6


def test_every_marble_begins_in_the_full_cup(bench: TaskHarness) -> None:
    for seed in range(2):
        source, _ = _sides(bench, seed)
        assert bench.hold(30) == 0
        assert marbles_in(bench.sim, source) == len(MARBLES)
