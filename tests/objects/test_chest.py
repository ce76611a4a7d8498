import manifold3d
import numpy as np
import pytest
import trimesh

from duobench.objects.chest import (
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
from duobench.objects.shapes import cylinder
from duobench.objects.solid import PLA_DENSITY, Solid, mass_properties, mesh_of, printable
from duobench.objects.solid import manifold_of as exact
from duobench.spatial import SE3

GREY = (0.5, 0.5, 0.5, 1.0)
PARTS = {"box": chest_box(GREY), "lid": chest_lid(GREY)}


def mesh(solid: Solid) -> trimesh.Trimesh:
    surface = printable(solid)
    return trimesh.Trimesh(vertices=surface.vertices, faces=surface.faces, process=False)


@pytest.mark.parametrize("name", PARTS)
def test_a_part_is_one_watertight_piece_that_weighs_its_volume(name: str) -> None:
    solid = PARTS[name]
    body = mesh(solid)
    assert body.is_watertight
    assert body.body_count == 1
    assert mass_properties(solid).mass == pytest.approx(body.volume * PLA_DENSITY)


@pytest.mark.parametrize("name", PARTS)
def test_what_collides_is_what_is_drawn(name: str) -> None:
    solid = PARTS[name]
    union = exact(solid.shapes[0])
    for shape in solid.shapes[1:]:
        union += exact(shape)
    collides = mesh_of(union)
    volume = trimesh.Trimesh(collides.vertices, collides.faces, process=False).volume
    assert mesh(solid).volume == pytest.approx(volume, rel=0.02)


def printed(solid: Solid) -> manifold3d.Manifold:
    """What a printer makes of it."""
    surface = printable(solid)
    vertices = np.array(surface.vertices, order="C")
    faces = np.array(surface.faces, dtype=np.uint64, order="C")
    return manifold3d.Manifold(manifold3d.Mesh64(vertices, faces))


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
