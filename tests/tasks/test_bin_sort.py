import pytest

from duobench.experts.bin_sort import script
from duobench.experts.motion import Arms, Script, down, move, pick
from duobench.solids.blocks import CUBE_EDGE
from duobench.spatial import SE3
from duobench.tasks.bin_sort import TASK
from duobench.types import Side
from tests.stageplay import Stageplay

IN_BOWL = 0.004 + CUBE_EDGE / 2 + 0.0005
"""Height of a cube's centre above the underside of the bowl that it lies in, in metres."""


@pytest.fixture(scope="module")
def bench() -> Stageplay:
    return Stageplay(TASK)


def _in(bench: Stageplay, bowl: str) -> SE3:
    return bench.sim.pose(bowl) @ SE3.at(z=IN_BOWL)


def test_the_expert_sorts_both_cubes(bench: Stageplay) -> None:
    for seed in (3, 17):
        bench.start(seed)
        assert bench.run_for(script, TASK.horizon) == 5
        assert bench.history == sorted(bench.history)
        assert {1, 2} <= set(bench.history)


def test_a_cube_in_its_bowl_counts_and_both_are_the_end(bench: Stageplay) -> None:
    bench.start(0)
    bench.put(white_cube=_in(bench, "white_bowl"))
    assert bench.hold(10) == 3
    bench.put(black_cube=_in(bench, "black_bowl"))
    assert bench.hold(10) == 5


def test_cubes_in_each_others_bowls_do_not_count(bench: Stageplay) -> None:
    bench.start(0)
    bench.put(white_cube=_in(bench, "black_bowl"), black_cube=_in(bench, "white_bowl"))
    assert bench.hold(20) == 0


def test_a_cube_held_above_its_bowl_does_not_count(bench: Stageplay) -> None:
    bench.start(0)

    def carry(arms: Arms) -> Script:
        x, y, _ = arms.sim.position("white_cube")
        yaw = arms.sim.pose("white_cube").yaw
        yield from pick(arms, Side.LEFT, down(x, y, 0.028, yaw=yaw))
        x, y, _ = arms.sim.position("white_bowl")
        yield from move(arms, {Side.LEFT: down(x, y, 0.10)})
        yield from move(arms, {Side.LEFT: down(x, y, 0.05)}, speed=0.1)

    assert bench.act(carry) == 1
    assert bench.hold(20) == 1
