import numpy as np
import pytest

from duobench.experts.motion import Arms, Script, move
from duobench.experts.pour_marbles import script, take
from duobench.solids.cup import HEAP, HEIGHT, INNER_RADIUS, OUTER_RADIUS, WALL, cup, marble
from duobench.solids.solid import PLA_DENSITY, corner_points, mass_properties, printable
from duobench.spatial import SE3
from duobench.tasks.pour_marbles import CUPS, MARBLES, SQUARES, TASK
from duobench.types import SIDES, Side
from tests.stageplay import Stageplay

STEPS_TO_RAISE = 90
"""Control steps in which the expert has raised both cups, and has not poured yet."""


@pytest.fixture(scope="module")
def bench() -> Stageplay:
    return Stageplay(TASK)


def _sides(bench: Stageplay, seed: int) -> tuple[Side, Side]:
    """Source and target of a seed."""
    full = Side(bench.start(seed).variants["full"])
    return full, full.other


def _raised(bench: Stageplay, seed: int) -> tuple[Side, Side]:
    """An episode in which both arms have raised their cups."""
    sides = _sides(bench, seed)
    assert bench.run_for(script, STEPS_TO_RAISE) == 3
    return sides


def _marbles(base: SE3) -> dict[str, SE3]:
    return {name: base @ SE3.at(*at) for name, at in zip(MARBLES, HEAP, strict=True)}


def _home(bench: Stageplay, offset: float = 0.0) -> dict[str, SE3]:
    return {
        CUPS[side]: SE3(np.eye(3), bench.sim.position(SQUARES[side])).moved(y=offset)
        for side in SIDES
    }


def _in_cup(bench: Stageplay, side: Side) -> int:
    local = bench.sim.pose(CUPS[side]).inverse().apply([bench.sim.position(m) for m in MARBLES])
    across = np.hypot(local[:, 0], local[:, 1]) < INNER_RADIUS
    return int((across & (local[:, 2] > 0) & (local[:, 2] < HEIGHT)).sum())


def test_the_expert_pours_either_way_and_passes_the_stages_in_order(bench: Stageplay) -> None:
    seeds = {}
    for seed in range(10):
        seeds.setdefault(_sides(bench, seed)[0], seed)
    assert set(seeds) == set(SIDES)
    for seed in seeds.values():
        bench.start(seed)
        assert bench.run_for(script, TASK.horizon) == 6
        assert bench.history == sorted(bench.history)
        assert {3, 4, 5, 6} <= set(bench.history)


def test_the_instruction_names_source_and_target(bench: Stageplay) -> None:
    full, empty = _sides(bench, 0)
    text = TASK.instruct(bench.start(0))
    assert f"from the {full} cup into the {empty} cup" in text


# --- what must not count -----------------------------------------------------------------------


def test_marbles_on_the_table_do_not_count(bench: Stageplay) -> None:
    _raised(bench, 0)
    bench.put(**_marbles(SE3.at(0.5, 0.0, 0.001 - WALL)))
    assert bench.hold(10) == 3


def test_marbles_in_the_air_above_the_cup_do_not_count(bench: Stageplay) -> None:
    _, target = _raised(bench, 0)
    bench.put(**_marbles(bench.sim.pose(CUPS[target]).moved(z=HEIGHT)))
    assert bench.stage == 3


def test_marbles_that_fell_into_the_target_count(bench: Stageplay) -> None:
    _, target = _raised(bench, 0)
    bench.put(**_marbles(bench.sim.pose(CUPS[target]).moved(z=0.001)))
    assert bench.hold(5) == 5


def test_cups_put_back_without_pouring_do_not_count(bench: Stageplay) -> None:
    source, _ = _raised(bench, 0)
    cups = _home(bench)
    bench.start(0)
    bench.put(**cups, **_marbles(cups[CUPS[source]].moved(z=0.001)))
    assert bench.hold(20) == 0
    assert _in_cup(bench, source) == len(MARBLES)


def test_full_marks_need_both_cups_on_their_squares(bench: Stageplay) -> None:
    for offset, stage in ((0.0, 6), (0.06, 5)):
        _, target = _raised(bench, 0)
        cups = _home(bench, offset)
        bench.act(_let_go)
        bench.put(**cups, **_marbles(cups[CUPS[target]].moved(z=0.001)))
        assert bench.hold(20) == stage


def test_pouring_into_a_cup_that_stands_does_not_count(bench: Stageplay) -> None:
    _, target = _sides(bench, 0)
    bench.put(**_marbles(bench.sim.pose(CUPS[target]).moved(z=0.001)))
    assert bench.hold(5) == 0


def _let_go(arms: Arms) -> Script:
    arms.openings[:] = 1.0
    yield from move(arms, {side: arms.targets[side].moved(z=0.25) for side in SIDES})


# --- physics -----------------------------------------------------------------------------------


def test_marbles_stay_in_a_cup_that_is_carried_upright(bench: Stageplay) -> None:
    source, _ = _sides(bench, 1)

    def carry(arms: Arms) -> Script:
        yield from take(arms, source)
        for y in (0.12, -0.12):
            yield from move(arms, {source: arms.targets[source].moved(y=y, z=0.02)}, speed=0.3)

    bench.act(carry)
    assert _in_cup(bench, source) == len(MARBLES)
    assert bench.stage == 1


def test_a_reset_leaves_every_marble_at_rest_in_the_full_cup(bench: Stageplay) -> None:
    for seed in range(5):
        source, _ = _sides(bench, seed)
        assert not bench.sim.contacts.deepest(0.0005)
        before = [bench.sim.position(m).copy() for m in MARBLES]
        assert bench.hold(30) == 0
        moved = np.linalg.norm(np.array(before) - [bench.sim.position(m) for m in MARBLES], axis=1)
        assert moved.max() < 0.004
        assert _in_cup(bench, source) == len(MARBLES)


# --- objects -----------------------------------------------------------------------------------


def test_a_cup_fits_the_gripper_and_weighs_what_it_prints() -> None:
    solid = cup((1.0, 1.0, 1.0, 1.0))
    outside = 8 * np.tan(np.pi / 8) * OUTER_RADIUS**2 * HEIGHT
    inside = 8 * np.tan(np.pi / 8) * INNER_RADIUS**2 * (HEIGHT - WALL)
    assert mass_properties(solid).mass == pytest.approx(PLA_DENSITY * (outside - inside))
    assert 2 * OUTER_RADIUS < 0.085
    mesh = printable(solid)
    edges = np.sort(np.vstack([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert np.ptp(corner_points(solid), axis=0) == pytest.approx(np.ptp(mesh.vertices, axis=0))


def test_a_marble_is_glass() -> None:
    assert mass_properties(marble((0.0, 0.0, 1.0, 1.0))).mass == pytest.approx(0.0013, rel=0.02)
