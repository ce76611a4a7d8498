import math
from dataclasses import replace
from functools import lru_cache

import manifold3d
import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ
from duobench.tasks.experts.scripts.join_blocks import script
from duobench.tasks.stages.joining import LOST_SECONDS
from duobench.tasks.stages.placing import REST_SECONDS
from duobench.world.objects import joint_blocks as bars
from duobench.world.objects.solid import manifold_of
from tests.task_harness import TaskHarness

GREY = (0.5, 0.5, 0.5, 1.0)
AIR = SE3.at(0.45, 0.0, 0.25)
"""A place in the air where nothing else is."""
LENGTH = bars.BAR[0]
ASIDE = SE3.at(0.85, 0.35)
"""A place for the wall where no arm is."""
TURNED = SE3.about((0, 0, 1), math.pi)
REST_STEPS = round(REST_SECONDS * CONTROL_HZ)
LOST_STEPS = round(LOST_SECONDS * CONTROL_HZ)


def tip_inside(bench: TaskHarness) -> float:
    """How deep the light block's peg is in the dark one's back socket, in metres."""
    x, y, z = bench.sim.relative_position("light_block", "dark_block")
    return x + LENGTH + bars.PEG_LENGTH if math.hypot(y, z) < bars.PEG_WIDTH / 2 else -1.0


def joined(dark: SE3, depth: float = bars.PEG_LENGTH) -> SE3:
    """Pose of a light block whose peg is this deep in a dark block's back socket."""
    return dark @ SE3.at(-LENGTH - bars.PEG_LENGTH + depth)


def mounted(bench: TaskHarness, depth: float = bars.PEG_LENGTH) -> SE3:
    """Pose of a dark block that has the wall's peg this deep in its front socket."""
    tip = bars.WALL_TIP.translation
    return bench.sim.pose("wall") @ SE3.at(tip[0] + depth - LENGTH / 2, 0.0, tip[2])


@lru_cache(maxsize=1)
def plugged_state(bench: TaskHarness) -> np.ndarray:
    """The simulation where each arm holds its block, and the peg is 5 mm in."""
    bench.start(0)
    bench.run_until(script, lambda: tip_inside(bench) > 0.005)
    return bench.sim.get_state()


def plugging_in(bench: TaskHarness) -> SE3:
    """Each arm holds its block since before the peg went in; the pose of the dark block.

    Moved by a few millimetres, within the planes of the pads, a block stays grasped.
    """
    bench.sim.set_state(plugged_state(bench))
    bench.progress.reset(bench.sim, {})
    dark = bench.sim.pose("dark_block")
    for depth in (-0.001, 0.005):
        bench.put(light_block=joined(dark, depth))
        assert both_grasped(bench)
        assert bench.stage == 1
    return dark


def both_grasped(bench: TaskHarness) -> bool:
    contacts = bench.sim.contacts
    return contacts.grasped("left", "light_block") and contacts.grasped("right", "dark_block")


# --- joined: what counts, and what must not ----------------------------------------------------


def askew(degrees: float) -> SE3:
    """A turn about the middle of the light block's tip."""
    tip = SE3(np.eye(3), bars.LIGHT_TIP.translation)
    return tip @ SE3.about((0, 1, 0), math.radians(degrees)) @ tip.inverse()


@pytest.mark.parametrize(
    ("depth", "off", "stage"),
    [
        (-0.001, SE3(), 1),
        (0.009, SE3(), 1),
        (0.011, SE3(), 2),
        (bars.PEG_LENGTH, SE3(), 2),
        (0.015, SE3.at(z=0.0035), 2),
        (0.015, SE3.at(z=0.0045), 1),
        (0.012, askew(8.0), 2),
        (0.012, askew(12.0), 1),
    ],
    ids=["out", "9 mm", "11 mm", "full", "aside", "too far aside", "askew", "too askew"],
)
def test_the_blocks_are_joined_from_ten_millimetres_on_straight_and_in_the_socket(
    bench: TaskHarness, depth: float, off: SE3, stage: int
) -> None:
    dark = plugging_in(bench)
    bench.put(light_block=joined(dark, depth) @ off)
    assert both_grasped(bench)
    assert bench.stage == stage


def test_blocks_side_by_side_do_not_count(bench: TaskHarness) -> None:
    dark = plugging_in(bench)
    bench.put(light_block=dark.moved(y=bars.BAR[1] - 0.0001))
    assert bench.sim.contacts.between("light_block", "dark_block")
    bench.put(light_block=joined(dark, 0.0))
    bench.put(light_block=dark @ SE3.at(-LENGTH + 0.0001) @ TURNED)
    assert bench.sim.contacts.between("light_block", "dark_block")
    assert bench.stage == 1


def test_joined_with_no_arm_near_does_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    bench.put(dark_block=AIR, light_block=joined(AIR))
    bench.put(wall=ASIDE)
    dark = mounted(bench)
    bench.put(dark_block=dark, light_block=joined(dark))
    assert bench.rest(REST_STEPS) == 0
    plugging_in(bench)
    bench.put(dark_block=AIR, light_block=joined(AIR))
    assert bench.rest(REST_STEPS) == 1


def test_joined_on_the_wall_does_not_count(bench: TaskHarness) -> None:
    dark = plugging_in(bench)
    wall = dark @ SE3.at(LENGTH / 2) @ SE3.at(-bars.WALL_TIP.translation[0] - 0.001)
    bench.put(wall=wall.moved(z=-bars.PEG_HEIGHT), light_block=joined(dark))
    assert both_grasped(bench)
    assert bench.stage == 1
    # Drawn off the wall, they are no better: the wall held the one while the other came in.
    bench.put(wall=ASIDE)
    assert bench.stage == 1
    bench.put(light_block=joined(dark, -0.001))
    bench.put(light_block=joined(dark, 0.011))
    assert bench.stage == 2


@pytest.mark.parametrize(("steps", "stage"), [(LOST_STEPS - 1, 2), (LOST_STEPS + 1, 1)])
def test_a_grasp_may_flicker_and_not_be_lost_while_the_peg_goes_in(
    bench: TaskHarness, steps: int, stage: int
) -> None:
    dark = plugging_in(bench)
    away = dark.moved(y=0.1)
    bench.put(dark_block=away, light_block=joined(away, 0.005))
    assert not both_grasped(bench)
    bench.rest(steps - 1)
    bench.put(dark_block=dark, light_block=joined(dark, 0.011))
    assert both_grasped(bench)
    assert bench.stage == stage
    # Taken apart and plugged in again, they count.
    bench.put(light_block=joined(dark, -0.001))
    bench.put(light_block=joined(dark, 0.011))
    assert bench.stage == 2


def test_blocks_are_grasped_before_the_peg_goes_in(bench: TaskHarness) -> None:
    dark = plugging_in(bench)
    bench.progress.reset(bench.sim, {})
    bench.put(light_block=AIR)
    assert not both_grasped(bench)
    bench.put(light_block=joined(dark, 0.011))
    assert both_grasped(bench)
    assert bench.rest(REST_STEPS) == 1


# --- on the wall: what counts, and what must not -----------------------------------------------


def on_the_wall(bench: TaskHarness, in_hand: float = 0.005) -> SE3:
    """The blocks were joined; the pose of the dark one on a wall that stands where no arm is.

    The wall's peg was already so deep, in metres, in the dark block while an arm held it.
    """
    dark = plugging_in(bench)
    bench.put(light_block=joined(dark))
    assert bench.stage == 2
    tip = bars.WALL_TIP.translation
    bench.put(wall=dark @ SE3.at(LENGTH / 2 - in_hand - tip[0], 0.0, -tip[2]))
    assert both_grasped(bench)
    bench.sim.place("wall", ASIDE)
    bench.sim.forward()
    dark = mounted(bench, 0.005)
    bench.put(dark_block=dark, light_block=joined(dark))
    assert bench.stage == 2
    return mounted(bench)


@pytest.mark.parametrize(
    ("wall_depth", "light_depth", "stage"),
    [(0.009, 0.02, 2), (0.02, 0.009, 2), (0.011, 0.011, 3), (0.024, 0.024, 3)],
)
def test_both_pegs_go_in_ten_millimetres(
    bench: TaskHarness, wall_depth: float, light_depth: float, stage: int
) -> None:
    on_the_wall(bench)
    dark = mounted(bench, wall_depth)
    bench.put(dark_block=dark, light_block=joined(dark, light_depth))
    assert bench.rest(REST_STEPS) == stage


@pytest.mark.parametrize("block", ["light_block", "dark_block"])
def test_a_moving_pair_does_not_count(bench: TaskHarness, block: str) -> None:
    dark = on_the_wall(bench)
    for name, pose in (("dark_block", dark), ("light_block", joined(dark))):
        bench.sim.place(name, pose)
    bench.push(block, -0.06, first=2)
    assert bench.rest(2 * REST_STEPS) == 2
    bench.put(dark_block=dark, light_block=joined(dark))
    assert bench.rest(REST_STEPS) == 3


@pytest.mark.parametrize(
    ("in_hand", "apart", "left", "stage"),
    [
        (0.001, None, False, 3),
        (-0.002, None, False, 2),
        (0.005, 0.004, False, 3),
        (0.005, 0.002, False, 2),
        (0.005, None, True, 2),
    ],
    ids=["onto the tip", "not onto it", "nearly apart", "apart", "left the wall"],
)
def test_a_hand_brings_the_pair_onto_the_peg_and_it_stays_there(
    bench: TaskHarness, in_hand: float, apart: float | None, left: bool, stage: int
) -> None:
    dark = on_the_wall(bench, in_hand)
    if apart is not None:
        bench.put(dark_block=dark, light_block=joined(dark, apart))
    if left:
        bench.put(dark_block=AIR, light_block=joined(AIR))
    bench.put(dark_block=dark, light_block=joined(dark))
    assert bench.rest(2 * REST_STEPS) == stage


def test_the_dark_block_on_the_wall_without_the_light_one_does_not_count(
    bench: TaskHarness,
) -> None:
    dark = on_the_wall(bench)
    bench.put(dark_block=dark, light_block=AIR)
    assert bench.rest(REST_STEPS) == 2
    # Nor with the light one where it would be without a dark one between.
    bench.put(dark_block=AIR, light_block=joined(dark).moved(x=LENGTH))
    assert bench.rest(REST_STEPS) == 2


@pytest.mark.parametrize("short", [0.0005, 0.003])
def test_a_mounted_pair_stays_for_good(bench: TaskHarness, short: float) -> None:
    """From the moment in which it is let go, straight, it droops into its play and stays."""
    on_the_wall(bench)
    dark = mounted(bench, bars.PEG_LENGTH - short)
    bench.put(dark_block=dark, light_block=joined(dark, bars.PEG_LENGTH - short))
    assert not bench.sim.contacts.deepest(0.0002)
    assert bench.hold(30) == 3
    drooped = bench.sim.position("light_block").copy()
    assert drooped[2] > bars.PEG_HEIGHT - 0.010
    bench.hold(270)
    assert bench.progress.final_holds
    assert np.linalg.norm(bench.sim.position("light_block") - drooped) < 0.0005
    assert not bench.sim.contacts.deepest(0.0001)


def test_a_peg_does_not_pass_through_a_bar(bench: TaskHarness) -> None:
    bench.start(0)
    bench.put(dark_block=AIR, light_block=joined(AIR).moved(y=0.008))
    assert bench.sim.contacts.between("dark_block", "light_block")


def test_a_peg_fits_its_socket_with_a_printers_play() -> None:
    """The exact solids: straight in without overlap, none left when moved by more than the play."""

    def overlap(depth: float, aside: float) -> float:
        pose, volume = joined(SE3(), depth).moved(y=aside), 0.0
        light = manifold3d.Manifold()
        for shape in bars.light_bar(GREY).shapes:
            light += manifold_of(replace(shape, pose=pose @ shape.pose))
        for shape in bars.dark_bar(GREY).shapes:
            volume += (light ^ manifold_of(shape)).volume()
        return volume

    full = bars.PEG_LENGTH - 1e-6
    for depth in np.linspace(0.0, full, 7):
        assert overlap(depth, 0.9 * bars.CLEARANCE) == pytest.approx(0.0, abs=1e-15)
    assert overlap(full, 1.1 * bars.CLEARANCE) > 1e-10
