import manifold3d
import numpy as np
import pytest
import trimesh

from duobench.solids.chest import HINGE, OUTER_Y, PIN_RADIUS, RIM_HEIGHT, chest_box, chest_lid
from duobench.solids.shapes import cylinder
from duobench.solids.solid import PLA_DENSITY, Solid, mass_properties, mesh_of, printable
from duobench.solids.solid import manifold_of as exact
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


def overlap(solid: Solid, radius: float, axis: SE3) -> float:
    """Volume in m³ that a pin along y through `axis` shares with a solid."""
    surface = printable(solid)
    vertices = np.array(surface.vertices, order="C")
    faces = np.array(surface.faces, dtype=np.uint64, order="C")
    body = manifold3d.Manifold(manifold3d.Mesh64(vertices, faces))
    pose = axis @ SE3.about((1, 0, 0), np.pi / 2)
    return (body ^ exact(cylinder(radius, 2 * OUTER_Y, at=pose))).volume()


@pytest.mark.parametrize(("name", "axis"), [("box", SE3.at(*HINGE)), ("lid", SE3())])
def test_a_pin_runs_through_lugs_and_barrel(name: str, axis: SE3) -> None:
    assert overlap(PARTS[name], PIN_RADIUS - 0.0001, axis) == pytest.approx(0.0, abs=1e-12)
    assert overlap(PARTS[name], PIN_RADIUS + 0.001, axis) > 1e-8


def test_the_hinge_is_above_the_rim() -> None:
    assert HINGE[2] > RIM_HEIGHT
