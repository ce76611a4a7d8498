import math

import numpy as np
import pytest

from tests.tools.meshes.shapes import area, box, grid, normals, sphere
from tools.meshes.geometry import Mesh
from tools.meshes.topology import clean, fill_holes, moved, split_creases, with_part

CORNER = 7


def holed_plate(hole: slice) -> tuple[np.ndarray, np.ndarray]:
    """A plate of ten by ten unit squares, less a square hole, and its triangles."""
    plate = grid(10, 10, 1.0)
    centre = plate.vertices[plate.faces].mean(axis=1)
    inside = ((centre[:, :2] > hole.start) & (centre[:, :2] < hole.stop)).all(axis=1)
    return plate.vertices, with_part(plate.faces[~inside], CORNER)


def test_clean_drops_empty_repeated_and_back_to_back_triangles():
    faces = np.array(
        [
            (0, 1, 2, 0),
            (1, 2, 0, 0),  # the same, turned
            (3, 3, 4, 0),  # empty
            (5, 6, 7, 0),
            (5, 7, 6, 0),  # back to back with the one before
            (8, 9, 10, 0),
            (8, 10, 9, 1),  # the back of another part stays
        ]
    )
    assert clean(faces).tolist() == [[0, 1, 2, 0], [8, 9, 10, 0], [8, 10, 9, 1]]


def test_clean_takes_an_empty_list():
    assert clean(np.empty((0, 4), dtype=np.int64)).shape == (0, 4)


def test_moved_vertices_keep_their_part():
    assert moved(np.array([(0, 1, 2, 5)]), np.array([4, 3, 1])).tolist() == [[4, 3, 1, 5]]


def test_a_small_hole_is_closed_in_the_sense_of_its_surroundings():
    vertices, faces = holed_plate(slice(4, 6))
    filled_vertices, filled = fill_holes(vertices, faces, perimeter=8.5)
    mesh = Mesh(vertices=filled_vertices, faces=filled[:, :3].astype(np.int32))
    assert area(mesh) == pytest.approx(100.0)
    assert (normals(mesh)[:, 2] > 0).all()
    assert set(filled[:, 3]) == {CORNER}


def test_a_larger_hole_and_the_outline_stay_open():
    vertices, faces = holed_plate(slice(4, 6))
    filled_vertices, filled = fill_holes(vertices, faces, perimeter=7.5)
    np.testing.assert_array_equal(filled_vertices, vertices)
    np.testing.assert_array_equal(filled, faces)


def test_an_inlay_goes_and_a_closed_piece_stays():
    plate, ball = grid(10, 10, 1.0), sphere(0.1)
    inlay = grid(1, 1, 0.5)
    pieces, faces, count = [plate, inlay, ball], [], 0
    for piece in pieces:
        faces.append(with_part(piece.faces + count, 0))
        count += len(piece.vertices)
    vertices = np.concatenate([piece.vertices for piece in pieces])
    _, kept = fill_holes(vertices, np.concatenate(faces), perimeter=3.0)
    assert len(kept) == len(plate.faces) + len(ball.faces)


def test_every_side_of_a_box_gets_vertices_of_its_own():
    mesh = box((1.0, 1.0, 1.0))
    old, faces = split_creases(mesh.vertices, mesh.faces, cosine=0.766)
    assert len(old) == 24
    np.testing.assert_array_equal(old[faces], mesh.faces)


def test_a_round_surface_is_not_parted():
    mesh = sphere(1.0)
    old, faces = split_creases(mesh.vertices, mesh.faces, cosine=0.766)
    np.testing.assert_array_equal(np.sort(old), np.arange(len(mesh.vertices)))
    np.testing.assert_array_equal(old[faces], mesh.faces)


def test_a_prism_is_parted_at_its_rims_only():
    sides = 12
    angle = 2 * math.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices = np.concatenate(
        [
            np.concatenate([ring, np.zeros((sides, 1))], axis=1),
            np.concatenate([ring, np.ones((sides, 1))], axis=1),
        ]
    )
    k = np.arange(sides)
    after = (k + 1) % sides
    wall = [
        np.stack([k, after, after + sides], axis=1),
        np.stack([k, after + sides, k + sides], axis=1),
    ]
    caps = [
        np.stack([np.zeros(sides - 2, int), k[2:], k[1:-1]], axis=1),
        np.stack([np.zeros(sides - 2, int), k[1:-1], k[2:]], axis=1) + sides,
    ]
    old, _ = split_creases(vertices, np.concatenate(wall + caps), cosine=0.766)
    assert len(old) == 4 * sides
