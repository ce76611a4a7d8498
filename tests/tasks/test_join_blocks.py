import math

import numpy as np
import pytest

from duobench.experts.join_blocks import script
from duobench.solids import joint_blocks as bars
from duobench.solids.solid import (
    PLA_DENSITY,
    Solid,
    manifold_of,
    mass_properties,
    mesh_of,
    printable,
)
from duobench.spatial import SE3
from duobench.tasks.join_blocks import TASK
from tests.stageplay import Stageplay

STEPS_TO_TAKE = 70
"""Control steps in which the expert has taken both bars, and has not joined them yet."""
GREY = (0.5, 0.5, 0.5, 1.0)
AIR = SE3.at(0.45, 0.0, 0.25)
"""A place in the air where nothing else is."""
LENGTH = bars.BAR[0]


@pytest.fixture(scope="module")
def bench() -> Stageplay:
    return Stageplay(TASK)


def _taken(bench: Stageplay) -> None:
    bench.start(0)
    assert bench.run_for(script, STEPS_TO_TAKE) == 1


def _mounted(depth: float = bars.PEG_LENGTH) -> SE3:
    """Pose of a dark bar that has the wall's peg this deep in its front socket."""
    tip = 0.7 + bars.WALL_TIP.translation[0]
    return SE3.at(tip + depth - LENGTH / 2, 0.0, bars.PEG_HEIGHT)


def _joined(dark: SE3, depth: float = bars.PEG_LENGTH) -> SE3:
    """Pose of a light bar whose peg is this deep in the dark bar's back socket."""
    return dark @ SE3.at(-LENGTH - bars.PEG_LENGTH + depth)


def test_the_expert_passes_the_stages_in_order(bench: Stageplay) -> None:
    for seed in (3, 17):
        bench.start(seed)
        assert bench.run_for(script, TASK.horizon) == 3
        assert sorted(set(bench.history)) == [0, 1, 2, 3]
        assert bench.history == sorted(bench.history)


# --- what counts, and what must not ------------------------------------------------------------


@pytest.mark.parametrize(("depth", "stage"), [(0.0, 1), (0.009, 1), (0.011, 2), (0.018, 2)])
def test_the_bars_are_joined_from_ten_millimetres_on(
    bench: Stageplay, depth: float, stage: int
) -> None:
    _taken(bench)
    bench.put(dark_block=AIR, light_block=_joined(AIR, depth))
    assert bench.stage == stage


def test_either_socket_counts(bench: Stageplay) -> None:
    _taken(bench)
    turned = AIR @ SE3.about((0, 0, 1), math.pi)
    bench.put(dark_block=turned, light_block=AIR.moved(x=-LENGTH))
    assert bench.stage == 2


def test_blocks_side_by_side_do_not_count(bench: Stageplay) -> None:
    _taken(bench)
    bench.put(dark_block=AIR, light_block=AIR.moved(y=bars.BAR[1]))
    assert bench.stage == 1
    bench.put(light_block=AIR.moved(x=-LENGTH - bars.PEG_LENGTH))
    assert bench.stage == 1


@pytest.mark.parametrize("gap", [0.0005, 0.1, 0.4])
def test_a_peg_that_points_away_from_the_dark_block_does_not_count(
    bench: Stageplay, gap: float
) -> None:
    _taken(bench)
    bench.put(dark_block=AIR, light_block=AIR.moved(x=LENGTH + gap))
    assert bench.stage == 1


def test_a_peg_beside_its_socket_or_askew_does_not_count(bench: Stageplay) -> None:
    _taken(bench)
    bench.put(dark_block=AIR, light_block=_joined(AIR).moved(y=0.005))
    assert bench.stage == 1
    mouth = AIR @ SE3.at(-LENGTH / 2)
    askew = mouth @ SE3.about((0, 0, 1), math.radians(12.0)) @ SE3.at(-LENGTH / 2)
    bench.put(light_block=askew)
    assert bench.stage == 1


def test_the_dark_block_on_the_wall_without_the_light_one_does_not_count(
    bench: Stageplay,
) -> None:
    _taken(bench)
    bench.put(dark_block=_mounted())
    assert bench.stage == 1
    behind = SE3.at(0.80, 0.0, bars.PEG_HEIGHT)
    for _ in range(2):
        bench.put(light_block=behind)
    assert bench.stage == 1
    for _ in range(2):
        bench.put(dark_block=behind.moved(x=0.1), light_block=behind)
    assert bench.stage == 1
    bench.put(dark_block=_mounted(), light_block=AIR)
    # Nor does it after the two were joined and came apart again.
    bench.put(dark_block=AIR, light_block=_joined(AIR))
    assert bench.stage == 2
    bench.put(dark_block=_mounted(), light_block=AIR)
    assert bench.stage == 2
    bench.put(light_block=_joined(_mounted()))
    assert bench.stage == 3


def test_joining_without_both_hands_does_not_count(bench: Stageplay) -> None:
    bench.start(0)
    bench.put(dark_block=AIR, light_block=_joined(AIR))
    bench.put(dark_block=_mounted(), light_block=_joined(_mounted()))
    assert bench.stage == 0


# --- physics -----------------------------------------------------------------------------------


def test_a_mounted_pair_carries_itself_without_overlap(bench: Stageplay) -> None:
    bench.start(0)
    dark = _mounted(0.0175)
    bench.put(dark_block=dark, light_block=_joined(dark, 0.0175))
    assert not bench.sim.contacts.deepest(0.0002)
    bench.hold(60)
    # The play of a millimetre a side lets the pair sag, not fall.
    assert bench.sim.position("dark_block")[2] > bars.PEG_HEIGHT - 0.012
    assert not bench.sim.contacts.between("dark_block", "table")


def test_a_peg_does_not_pass_through_a_bar(bench: Stageplay) -> None:
    bench.start(0)
    bench.put(dark_block=AIR, light_block=_joined(AIR).moved(y=0.008))
    assert bench.sim.contacts.between("dark_block", "light_block")


# --- objects -----------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [bars.light_bar, bars.dark_bar, bars.wall])
def test_picture_and_collision_are_one_shape(make) -> None:
    solid: Solid = make(GREY)
    union = manifold_of(solid.shapes[0])
    for shape in solid.shapes[1:]:
        union += manifold_of(shape)
    exact = printable(solid)
    edges = np.sort(np.vstack([exact.faces[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    volume = mass_properties(solid).mass / PLA_DENSITY
    assert union.volume() == pytest.approx(volume, rel=1e-6)
    corners = mesh_of(union).vertices
    assert corners.min(0) == pytest.approx(exact.vertices.min(0))
    assert corners.max(0) == pytest.approx(exact.vertices.max(0))


def test_a_reset_leaves_everything_apart_and_at_rest(bench: Stageplay) -> None:
    for seed in range(10):
        bench.start(seed)
        assert not bench.sim.contacts.deepest(0.0005)
        before = {name: bench.sim.position(name).copy() for name in bench.sim.props}
        assert bench.hold(10) == 0
        for name, position in before.items():
            assert np.linalg.norm(bench.sim.position(name) - position) < 0.001
