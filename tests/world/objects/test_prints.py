"""Every printable object is made of watertight bodies that a printer can make."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import manifold3d
import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.tasks import catalog
from duobench.world.objects import bowl, gate, maze_board
from duobench.world.objects.shapes import (
    JOINT_PLAY,
    OVERLAP,
    PRINTER,
    THINNEST_WALL,
    Shape,
    ShapeKind,
)
from duobench.world.objects.solid import (
    Mesh,
    Solid,
    manifold_from,
    mesh_of,
    pieces_of,
    placed,
    printable,
    union_of,
)

SHAPES_PROUD = 0.0001
"""How far in metres what collides may stand out of what is printed, and the other way round."""
BOWL_PROUD = bowl.RADIUS / np.cos(np.pi / bowl.WALL_SEGMENTS) - bowl.RADIUS + SHAPES_PROUD
"""The same of a bowl, whose round wall collides as flat boxes around it: at their corners."""
CUT_FROM_A_BLOCK = ("join_blocks/dark_block", "transfer_reorient/board")
"""What is printed as one block with holes; the shapes that collide around these only touch."""
NOISE = 1e-15
"""Volume in m³ that arithmetic leaves of nothing."""


@dataclass(frozen=True, kw_only=True)
class Print:
    """One solid that a layout has printed, and what collides in its place."""

    name: str
    solid: Solid
    shapes: tuple[Shape, ...]


def _prints() -> Iterator[Print]:
    """Every printable solid of every task and variant."""
    for task in map(catalog.get, catalog.names()):
        for prop in task.props if task.printable else ():
            for value in prop.variants or [""]:
                left_out = prop.variants[value].without_shapes if value else ()
                first, *others = prop.prints({prop.choice or "": value})
                felt = [s for k, s in enumerate(prop.solid.shapes) if k not in left_out]
                name = "/".join(filter(None, (task.id, prop.name, value)))
                yield Print(name=name, solid=first, shapes=tuple(felt))
                for part, solid in zip(prop.parts, others, strict=True):
                    yield Print(name=f"{name}/{part.name}", solid=solid, shapes=solid.shapes)


PRINTS = tuple(_prints())
prints = pytest.mark.parametrize("case", PRINTS, ids=lambda case: case.name)


def exact(mesh: Mesh) -> manifold3d.Manifold:
    """A mesh as a solid, which it must be."""
    solid = manifold_from(mesh)
    assert solid.status() is manifold3d.Error.NoError
    return solid


def assert_watertight(mesh: Mesh) -> None:
    """Every edge has one triangle on either side, and they run along it in opposite directions."""
    edges = np.vstack([mesh.faces[:, [k, (k + 1) % 3]] for k in range(3)])
    forward = {tuple(edge) for edge in edges.tolist()}
    assert len(forward) == len(edges)
    assert forward == {edge[::-1] for edge in forward}


def extent(mesh: Mesh, turn: SE3) -> float:
    """The longest edge of the box around a turned mesh, in metres."""
    return float(np.ptp(turn.apply(mesh.vertices), axis=0).max())


def proud(one: manifold3d.Manifold, other: manifold3d.Manifold) -> float:
    """How far in metres a solid stands out of another at most; holes that it fills do not count."""
    rest = mesh_of((one - other).as_original().simplify(1e-6))
    dot = manifold3d.Manifold.cube((1e-7,) * 3, True)
    gaps = (other.min_gap(dot.translate(point), 0.1) for point in rest.vertices.tolist())
    return max(gaps, default=0.0)


def shrunk(shape: Shape, margin: float) -> Shape:
    """A shape, smaller by a margin all around, or about so."""
    if shape.kind is ShapeKind.HULL:
        points = np.array(shape.points)
        middle = points.mean(axis=0)
        scale = 1 - 2 * margin / np.ptp(points, axis=0).min()
        smaller = middle + scale * (points - middle)
        return replace(shape, points=tuple(map(tuple, smaller.tolist())))
    edges = 2 if shape.kind is ShapeKind.BOX else 1
    return replace(shape, size=tuple(s - edges * margin for s in shape.size))


def test_all_printable_tasks_are_looked_at() -> None:
    printed = {case.name.split("/")[0] for case in PRINTS}
    assert printed == {name for name in catalog.names() if catalog.get(name).printable}
    assert len(printed) == 8
    assert sum(case.name.startswith("ball_maze/board/") for case in PRINTS) == 10


@prints
def test_every_piece_is_one_watertight_body_and_fits_the_printer_as_it_stands(case: Print) -> None:
    for mesh in (printable(case.solid), *pieces_of(case.solid)):
        assert_watertight(mesh)
        body = exact(mesh)
        assert len(body.decompose()) == 1
        assert body.volume() > 0
    assert all(extent(piece, SE3()) <= PRINTER for piece in pieces_of(case.solid))


def test_what_is_printed_in_pieces_would_not_fit_whole() -> None:
    turns = [SE3.at(yaw=np.radians(degrees)) for degrees in range(0, 90, 15)]
    split = [case for case in PRINTS if case.solid.pieces]
    assert {case.name.split("/")[0] for case in split} == {"ball_maze", "transfer_gate"}
    for case in split:
        assert min(extent(printable(case.solid), turn) for turn in turns) > PRINTER


@prints
def test_pieces_put_together_are_the_whole_but_for_the_play_of_joints(case: Print) -> None:
    whole = exact(printable(case.solid))
    pieces = [exact(mesh) for mesh in pieces_of(case.solid)]
    for one, other in itertools.combinations(pieces, 2):
        assert (one ^ other).volume() == pytest.approx(0.0, abs=NOISE)
    together = manifold3d.Manifold.batch_boolean(pieces, manifold3d.OpType.Add)
    assert (together - whole).volume() == pytest.approx(0.0, abs=NOISE)
    assert sum(piece.volume() for piece in pieces) == pytest.approx(whole.volume(), rel=0.01)


@prints
def test_what_collides_is_what_is_printed(case: Print) -> None:
    collides, printed = union_of(case.shapes), exact(printable(case.solid))
    tolerance = BOWL_PROUD if case.name.endswith("bowl") else SHAPES_PROUD
    assert proud(collides, printed) <= tolerance
    assert proud(printed, collides) <= tolerance


@prints
def test_shapes_of_a_body_overlap_and_do_not_only_touch(case: Print) -> None:
    if case.name in CUT_FROM_A_BLOCK or case.name.endswith("bowl"):
        assert case.solid.mesh is not None
        return
    smaller = union_of(shrunk(shape, OVERLAP / 20) for shape in case.solid.shapes)
    assert len(smaller.decompose()) == 1


@prints
def test_no_wall_is_thinner_than_a_printer_makes(case: Print) -> None:
    for mesh in pieces_of(case.solid):
        body, corners = exact(mesh), mesh.vertices[mesh.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        large = lengths > 1e-9  # a normal of a sliver is noise
        inwards = -normals[large] / lengths[large, None]
        middles = corners[large].mean(axis=1)
        for start, way in zip(middles + 1e-6 * inwards, inwards, strict=True):
            first = body.ray_cast(start.tolist(), (start + 2 * PRINTER * way).tolist())[0]
            assert first.distance * 2 * PRINTER >= THINNEST_WALL - 2e-6


def test_the_ring_comes_off_its_stand_upwards_only() -> None:
    base, post, ring = map(exact, pieces_of(gate.gate()))
    assert clash(ring.translate((0.0, 0.0, 0.02)), post) == 0.0
    for x, y, z in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, -1)):
        moved = ring.translate((2 * JOINT_PLAY * x, 2 * JOINT_PLAY * y, 2 * JOINT_PLAY * z))
        assert clash(moved, post) > 0.0
    assert clash(post.translate((0.0, 0.0, 0.02)), base) == 0.0
    assert clash(post.translate((0.0, 0.0, -JOINT_PLAY)), base) > 0.0


def test_a_grip_goes_into_the_board_from_below_and_carries_it() -> None:
    board, _, *grips = map(exact, pieces_of(maze_board.printable_board(maze_board.MAZES[0])))
    grip, *others = grips
    for drop in (0.005, 0.010, 0.020):
        assert clash(grip.translate((0.0, 0.0, -drop)), board) == 0.0
    assert clash(grip.translate((0.0, 0.0, JOINT_PLAY)), board) > 0.0
    assert clash(grip.translate((0.001, 0.0, 0.0)), board) > 0.0
    for turns, other in enumerate(others, 1):
        turned = placed(grip, SE3.at(yaw=turns * np.pi / 2))
        assert (turned - other).volume() == pytest.approx(0.0, abs=NOISE)


def clash(one: manifold3d.Manifold, other: manifold3d.Manifold) -> float:
    """Volume in m³ that two solids share, without what arithmetic leaves of nothing."""
    volume = (one ^ other).volume()
    return 0.0 if abs(volume) < NOISE else volume
