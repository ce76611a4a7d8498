import manifold3d
import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.world.objects.chest import (
    HINGE,
    HOLE_RADIUS,
    LID_LIMITS,
    LID_WIDTH,
    OUTER_Y,
    RIM_HEIGHT,
    THREAD_RADIUS,
    chest_box,
    chest_lid,
)
from duobench.world.objects.shapes import cylinder
from duobench.world.objects.solid import Solid, manifold_from, manifold_of as exact, printable

GREY = (0.5, 0.5, 0.5, 1.0)
PARTS = {"box": chest_box(GREY), "lid": chest_lid(GREY)}


def printed(solid: Solid) -> manifold3d.Manifold:
    """What a printer makes of it."""
    return manifold_from(printable(solid))


def overlap(solid: Solid, radius: float, axis: SE3) -> float:
    """Volume in m³ that a rod along y through `axis` shares with a solid."""
    pose = axis @ SE3.about((1, 0, 0), np.pi / 2)
    return (printed(solid) ^ exact(cylinder(radius, 2 * OUTER_Y, at=pose))).volume()


def clash(angle: float) -> float:
    """Volume in m³ that the printed lid, open by an angle, shares with the printed box."""
    pose = SE3.at(*HINGE) @ SE3.about((0, 1, 0), angle)
    lid = printed(PARTS["lid"]).transform(np.column_stack([pose.rotation, pose.translation]))
    return (printed(PARTS["box"]) ^ lid).volume()


@pytest.mark.parametrize(
    ("name", "axis", "radius"),
    [("box", SE3.at(*HINGE), HOLE_RADIUS), ("lid", SE3(), THREAD_RADIUS)],
)
def test_a_hole_for_screws_runs_through_lugs_and_barrel(
    name: str, axis: SE3, radius: float
) -> None:
    assert overlap(PARTS[name], radius - 0.0001, axis) == pytest.approx(0.0, abs=1e-12)
    assert overlap(PARTS[name], radius + 0.001, axis) > 1e-8


def test_an_m3_screw_of_20_mm_turns_in_the_lug_and_cuts_into_the_barrel() -> None:
    assert THREAD_RADIUS < 0.0015 < HOLE_RADIUS
    in_the_barrel = 0.020 - (OUTER_Y - LID_WIDTH) / 2
    assert in_the_barrel == pytest.approx(0.013)


def test_the_hinge_is_above_the_rim() -> None:
    assert HINGE[2] > RIM_HEIGHT


def test_posts_stop_the_printed_lid_where_the_simulated_one_stops() -> None:
    for angle in np.linspace(*LID_LIMITS, 30):
        assert clash(float(angle)) == pytest.approx(0.0, abs=1e-15)
    assert clash(LID_LIMITS[1] + np.radians(1.0)) > 1e-9
