"""What a printer is given: one watertight body a part, on the bed, no two in one place."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import lib3mf
import manifold3d
import numpy as np
import pytest

from duobench.core.errors import FabricationError, UnknownNameError
from duobench.core.spatial import SE3
from duobench.printing import PrintedPart, PrintJob, job_of, lay_out, stl_bytes, threemf_bytes
from duobench.printing.formats import BED_STEP, hex_colour
from duobench.tasks import catalog
from duobench.world.objects import Part, Prop, Solid, Variant, block
from duobench.world.objects.mazes import MAZES
from duobench.world.objects.shapes import KEPT_FREE, PRINTER, box
from tests.printing.printed import JOBS, PARTS, as_read, job, part

RED = (0.8, 0.1, 0.1, 1.0)
STEEP, FIRST_LAYER = 0.72, 2e-4
"""Share of an area that looks down from which on it needs support (46 degrees); metres."""
parts = pytest.mark.parametrize(("name", "of"), PARTS)
jobs = pytest.mark.parametrize("name", [name for name in JOBS if job(name).parts])


def task_with(*props: Prop) -> object:
    return replace(catalog.get("bin_sort"), id="mine", props=props, placements={})


def overhang(one: PrintedPart) -> float:
    """Area in m² that looks down by more than 45 degrees, that on the bed aside."""
    corners = one.mesh.vertices[one.mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(normals, axis=1)
    looks_down = normals[:, 2] < -STEEP * twice
    is_high = corners[:, :, 2].mean(axis=1) > FIRST_LAYER
    return float(twice[looks_down & is_high].sum() / 2)


@parts
def test_a_part_is_one_watertight_body_that_lies_on_the_bed_and_fits(name: str, of: str) -> None:
    mesh = as_read(part(name, of))
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert mesh.volume > 0
    assert mesh.area_faces.min() > 0
    low, high = np.array(mesh.bounds)
    assert low[2] == 0
    assert low[:2] + high[:2] == pytest.approx([0, 0], abs=1e-4)
    assert (high - low <= 1000 * PRINTER).all()
    heights = mesh.triangles[:, :, 2].max(axis=1)
    on_bed = mesh.area_faces[heights < 1e-6].sum()
    assert on_bed > 150 or of == "ball", "on a face and not on an edge"


@parts
def test_what_hangs_over_is_little_where_nothing_supports_it(name: str, of: str) -> None:
    # Bridges over sockets and slots and the lower quarter of the lid's barrel stay.
    area = 1e6 * overhang(part(name, of))
    if of == "ball":
        assert area > 150
    elif of == "chest-lid":
        assert area < 1100
    else:
        assert area < (600 if of == "board-frame" else 220)


@jobs
def test_no_two_parts_share_a_place_and_the_corner_is_kept_free(name: str) -> None:
    spots = lay_out(job(name).parts)
    assert len(spots) == sum(each.count for each in job(name).parts)
    boxes = [(each.bed, np.array([each.x, each.y]), each.part.size[:2] / 2) for each in spots]
    for _, middle, half in boxes:
        assert (middle - half >= -1e-9).all()
        assert (middle + half <= PRINTER + 1e-9).all()
    for (one_bed, one, half), (other_bed, other, room) in itertools.combinations(boxes, 2):
        apart = np.abs(one - other) - half - room
        assert one_bed != other_bed or apart.max() > 0.005
    corner = manifold3d.CrossSection.square(KEPT_FREE)
    for spot in spots:
        points = spot.part.mesh.vertices[:, :2]
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        outline = manifold3d.CrossSection.hull_points(points - middle + (spot.x, spot.y))
        assert outline.area() > 0
        assert (outline ^ corner).area() < 1e-9, spot.part.name


def read_strictly(data: bytes) -> tuple[lib3mf.Model, list[str]]:
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromBuffer(data)
    return model, [reader.GetWarning(k)[1] for k in range(reader.GetWarningCount())]


@jobs
def test_a_strict_reader_has_no_objection(name: str) -> None:
    model, warnings = read_strictly(threemf_bytes(job(name)))
    assert warnings == []
    assert model.GetUnit() == lib3mf.ModelUnit.MilliMeter
    data = model.GetMetaDataGroup()
    entries = [data.GetMetaData(k) for k in range(data.GetMetaDataCount())]
    texts = {entry.GetName(): entry.GetValue() for entry in entries}
    assert texts["Title"] == job(name).title
    assert set(texts) == {"Title", "Designer", "LicenseTerms", "Description"}


def all_of(iterator: Any, current: Callable[[Any], Any]) -> list[Any]:
    """What an iterator of lib3mf comes by."""
    found = []
    while iterator.MoveNext():
        found.append(current(iterator))
    return found


@jobs
def test_a_3mf_has_the_parts_with_their_names_colours_and_places(name: str) -> None:
    model, _ = read_strictly(threemf_bytes(job(name)))
    meshes = all_of(model.GetMeshObjects(), lambda each: each.GetCurrentMeshObject())
    objects = {mesh.GetName(): mesh for mesh in meshes}
    assert set(objects) == {each.name for each in job(name).parts}
    (colours,) = all_of(model.GetColorGroups(), lambda each: each.GetCurrentColorGroup())
    for each in job(name).parts:
        mesh = objects[each.name]
        assert mesh.IsManifoldAndOriented()
        assert mesh.GetTriangleCount() == len(each.mesh.faces)
        points = np.array([list(v.Coordinates) for v in mesh.GetVertices()])
        assert points == pytest.approx(1000 * each.mesh.vertices, abs=1e-4)
        resource, number, has_one = mesh.GetObjectLevelProperty()
        assert has_one
        assert resource == colours.GetResourceID()
        colour = colours.GetColor(number)
        seen = (colour.Red, colour.Green, colour.Blue)
        assert "#" + "".join(f"{value:02X}" for value in seen) == hex_colour(each.rgba)
    items = all_of(model.GetBuildItems(), lambda each: each.GetCurrent())
    spots = lay_out(job(name).parts)
    names = [item.GetObjectResource().GetName() for item in items]
    assert names == [spot.part.name for spot in spots]
    places = np.array([item.GetObjectTransform().Fields[3][:2] for item in items])
    expected = [(spot.x + spot.bed * BED_STEP, spot.y) for spot in spots]
    assert places == pytest.approx(1000 * np.array(expected), abs=1e-3)


def test_titles_with_any_characters_can_be_read() -> None:
    odd = replace(job("bin_sort"), title='<Ä & "bowl">', description="a < b")
    model, warnings = read_strictly(threemf_bytes(odd))
    assert warnings == []
    assert model.GetMetaDataGroup().GetMetaDataByKey("", "Title").GetValue() == odd.title


def test_equal_grips_are_one_part_that_is_printed_four_times() -> None:
    maze = job_of(catalog.get("ball_maze"))
    counts = {each.name: each.count for each in maze.parts}
    assert counts == {"board-frame": 1, "board_0-floor": 1, "board-grip": 4, "ball": 1}
    assert len({each.rgba for each in maze.parts}) == 4


def test_mazes_are_chosen_by_their_numbers() -> None:
    names = [each.name for each in job_of(catalog.get("ball_maze"), ("3", "7")).parts]
    assert names == ["board-frame", "board_3-floor", "board-grip", "board_7-floor", "ball"]
    with pytest.raises(UnknownNameError, match="Unknown variant of board '12'"):
        job_of(catalog.get("ball_maze"), ("12",))


def test_ten_mazes_are_one_frame_and_ten_floors() -> None:
    task = catalog.get("ball_maze")
    counts = {each.name: each.count for each in job("ball_maze").parts}
    floors = [f"board_{number}-floor" for number in range(len(MAZES))]
    assert counts == {"board-frame": 1, "board-grip": 4, "ball": 1, **dict.fromkeys(floors, 1)}
    whole = sum(each.count * each.mass for each in job_of(task).parts)
    floor = part("ball_maze", "board_0-floor").mass
    together = sum(each.count * each.mass for each in job("ball_maze").parts)
    assert together == pytest.approx(whole + 9 * floor, rel=1e-3)
    assert together < 0.5 * len(MAZES) * whole


def test_what_variants_share_is_the_same_in_all_of_them() -> None:
    shared: dict[str, PrintedPart] = {}
    for number in map(str, range(len(MAZES))):
        for each in job_of(catalog.get("ball_maze"), (number,)).parts:
            if not each.is_shared:
                continue
            first = shared.setdefault(each.name, each)
            assert np.array_equal(first.mesh.vertices, each.mesh.vertices)
            assert np.array_equal(first.mesh.faces, each.mesh.faces)
    assert set(shared) == {"board-frame", "board-grip"}


def test_what_is_too_large_is_refused_with_its_size() -> None:
    with pytest.raises(FabricationError, match=r"300 × 20 × 20 mm as it lies.*`pieces`"):
        job_of(task_with(Prop(name="pole", solid=lambda: block(0.3, 0.02, 0.02, RED))))


@pytest.mark.parametrize(
    ("prop", "message"),
    [
        (
            Prop(
                name="two",
                solid=Solid(
                    shapes=tuple(box(0.02, 0.02, 0.02, at=SE3.at(x)) for x in (0, 0.07)), rgba=RED
                ),
            ),
            "two cannot be printed: it is 2 bodies",
        ),
        (Prop(name="foil", solid=block(0.02, 0.02, 0.0005, RED)), r"20 × 20 × 0\.5 mm.* 0\.8 mm"),
        (
            Prop(
                name="gap",
                solid=block(0.02, 0.02, 0.02, RED),
                choice="it",
                variants={"open": Variant(without_shapes=frozenset({0}))},
            ),
            "'open' of 'gap' leaves out shapes.*`printed`",
        ),
    ],
)
def test_what_would_be_printed_otherwise_is_refused(prop: Prop, message: str) -> None:
    with pytest.raises(FabricationError, match=message):
        job_of(task_with(prop))


def test_the_print_turn_of_an_object_decides_which_side_is_up() -> None:
    turn = SE3.about((0, 1, 0), math.pi / 2)
    prop = Prop(
        name="tower",
        solid=lambda: block(0.02, 0.04, 0.2, RED),
        print_turn=turn,
        parts=(Part(name="arm", solid=lambda: block(0.01, 0.02, 0.03, RED)),),
    )
    tower, arm = job_of(task_with(prop)).parts
    assert tower.size == pytest.approx([0.2, 0.04, 0.02])
    assert arm.size == pytest.approx([0.01, 0.02, 0.03])
    assert (tower.name, arm.name) == ("tower", "tower-arm")


def test_files_of_objects_with_odd_names_are_told_apart() -> None:
    props = [
        Prop(name=name, solid=lambda: block(0.02, 0.02, 0.02, RED))
        for name in ("../a", "b c", "b/c", "B_c")
    ]
    names = [each.name for each in job_of(task_with(*props)).parts]
    assert len({name.lower() for name in names}) == len(props)
    assert all("/" not in name and not name.startswith(".") for name in names)


def test_a_task_that_cannot_be_printed_is_bought() -> None:
    mine = replace(task_with(Prop(name="pan", solid=lambda: block(0.5, 0.5, 0.1, RED))))
    bought = job_of(replace(mine, printable=False))
    assert bought.parts == ()
    assert [item.name for item in bought.bought] == ["pan"]
    assert "500 × 500 × 100 mm" in bought.bought[0].sizes[0]


def test_every_object_is_printed_or_bought() -> None:
    for name in catalog.names():
        done: PrintJob = job(name)
        roots = (each.body.partition("/")[0] for each in done.parts)
        printed = {re.sub(r"_[0-9]+$", "", root) for root in roots}
        bought = {prop for item in done.bought for prop in item.props}
        for prop in catalog.get(name).props:
            assert (prop.name in printed) != (prop.name in bought), prop.name


def test_an_stl_does_not_look_like_text() -> None:
    data = stl_bytes(part("bin_sort", "white_cube").mesh, "solid")
    assert not data.startswith(b"solid")
    assert len(data) == 84 + 12 * 50
