"""Put down, not dropped: what hands do with a cube over the table."""

import math

import pytest

from duobench.core.types import Side
from duobench.tasks.bin_sort import TASK
from duobench.tasks.experts.handling import pick, pick_cube
from duobench.tasks.experts.motion import Arms, Script, down, move, nearest_turn, release
from duobench.tasks.stages.logic import Predicate
from duobench.tasks.stages.placing import lifted_off, low_over, put
from duobench.world.scene.naming import TABLE
from tests.predicate_probe import PredicateProbe
from tests.steps import do, pause, to
from tests.task_harness import TaskHarness

CUBE = "white_cube"
LOW = low_over(CUBE, TABLE, 0.0)


@pytest.fixture(scope="module")
def bench() -> TaskHarness:
    return TaskHarness(TASK)


def lower(arms: Arms, height: float) -> Script:
    """Bring the lowest point of the cube in the left hand to a height above the table."""
    tool = arms.tcp_pose(Side.LEFT)
    low = tool.moved(z=height - arms.sim.min_height(CUBE))
    yield from move(arms, {Side.LEFT: low}, speed=0.1)


pick_up = do((pick_cube, Side.LEFT, CUBE, 0.028))


def let_go(bench: TaskHarness, question: Predicate, height: float) -> bool:
    """Whether it holds after the left hand has let the cube go at a height above the table."""
    bench.start(0)
    bench.act(pick_up)
    probe = PredicateProbe(question, bench.sim)

    script = do((lower, height), (release, Side.LEFT), (to, Side.LEFT, down(0.45, 0.3, 0.3)))
    answers = [probe.ask() for _ in bench.steps(script)]
    assert bench.sim.contacts.between(CUBE, TABLE)
    return answers[-1]


@pytest.mark.parametrize(("height", "counts"), [(-0.003, True), (0.006, True), (0.020, False)])
def test_what_is_let_go_low_is_put_and_what_is_let_go_higher_is_dropped(
    bench: TaskHarness, height: float, counts: bool
) -> None:
    assert let_go(bench, put(CUBE, LOW), height) == counts


def test_only_the_sides_that_are_named_put_it_down(bench: TaskHarness) -> None:
    assert let_go(bench, put(CUBE, LOW, Side.LEFT), 0.0)
    assert not let_go(bench, put(CUBE, LOW, Side.RIGHT), 0.0)


@pytest.mark.parametrize(("lift", "counts"), [(0.0, False), (0.006, False), (0.02, True)])
def test_what_was_dropped_is_put_when_a_hand_has_lifted_it_again(
    bench: TaskHarness, lift: float, counts: bool
) -> None:
    """Though it is all the time where it may be let go, as in a vessel."""
    bench.start(0)
    bench.act(pick_up)
    near = low_over(CUBE, TABLE, 0.0, 0.05)
    probe = PredicateProbe(put(CUBE, near, again=lifted_off(CUBE, TABLE, 0.0)), bench.sim)

    def pick_again(arms: Arms) -> Script:
        x, y, _ = arms.sim.position(CUBE)
        grasp = down(x, y, 0.028, yaw=nearest_turn(arms.sim.pose(CUBE).yaw, math.pi / 2))
        yield from pick(arms, Side.LEFT, grasp, lift=lift)

    left, away = Side.LEFT, down(0.45, 0.3, 0.3)
    again = (pick_again, (pause, 10), (release, left), (to, left, away))
    script = do((lower, 0.08), (release, left), *again)
    answers = [probe.ask() for _ in bench.steps(script)]
    assert answers[-1] == counts
