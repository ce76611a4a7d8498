"""Normals by which curves look round and edges sharp."""

import math

import mujoco
import numpy as np
import pytest

from duobench.objects.bowl import bowl
from duobench.objects.shapes import CIRCLE_SEGMENTS, box, cylinder
from duobench.objects.solid import Mesh, manifold_of, mesh_of, printable
from duobench.scene.meshes import FLAT, add_visual_mesh, corner_normals

MESHES = {
    "box": mesh_of(manifold_of(box(0.1, 0.2, 0.3))),
    "cylinder": mesh_of(manifold_of(cylinder(0.1, 0.2))),
    "bowl": printable(bowl((1.0, 1.0, 1.0, 1.0))),
}


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_no_corner_turns_far_from_its_triangle(mesh: Mesh) -> None:
    corners = corner_normals(mesh.vertices, mesh.faces).reshape(-1, 3, 3)
    cosines = np.einsum("fcx,fx->fc", corners, face_normals(mesh.vertices, mesh.faces))
    assert np.linalg.norm(corners, axis=2) == pytest.approx(1.0)
    # Half the angle between neighbours on a circle.
    assert cosines.min() >= math.cos(math.pi / CIRCLE_SEGMENTS) - 1e-9


def test_edges_of_a_box_are_sharp() -> None:
    mesh = MESHES["box"]
    corners = corner_normals(mesh.vertices, mesh.faces)
    assert corners == pytest.approx(np.repeat(face_normals(mesh.vertices, mesh.faces), 3, axis=0))


def test_a_cylinder_is_round_along_its_side_and_flat_at_its_ends() -> None:
    mesh = MESHES["cylinder"]
    corners = corner_normals(mesh.vertices, mesh.faces)
    places = mesh.vertices[mesh.faces.ravel()]
    side = np.abs(corners[:, 2]) < 0.5
    assert corners[~side] == pytest.approx(np.sign(places[~side]) * [0.0, 0.0, 1.0])
    assert corners[side] == pytest.approx(places[side] * [10.0, 10.0, 0.0], abs=1e-6)


def test_the_normals_do_not_depend_on_how_a_face_is_cut() -> None:
    # Two roofs over one ground plan: their ridge lies on a smooth edge, cut one way or the other.
    vertices = np.array([[0, 0, 0], [1, 0, 0.05], [2, 0, 0], [0, 1, 0], [1, 1, 0.05], [2, 1, 0]])
    one = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
    other = np.array([[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4]])

    def at_ridge(faces: np.ndarray) -> np.ndarray:
        return corner_normals(vertices, faces)[faces.ravel() == 1][0]

    assert at_ridge(one) == pytest.approx(at_ridge(other))
    assert at_ridge(one) == pytest.approx([0.0, 0.0, 1.0])


@pytest.mark.parametrize("crease", [math.radians(8.0), FLAT])
@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_the_engine_draws_with_these_normals(mesh: Mesh, crease: float) -> None:
    spec = mujoco.MjSpec()
    name = add_visual_mesh(spec, "mesh", mesh, crease)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
    model = spec.compile()
    vertices = model.mesh_vert.astype(np.float64)
    assert model.mesh_facenum[0] == len(mesh.faces)
    corners = model.mesh_normal[model.mesh_facenormal]
    cosines = np.einsum("fcx,fx->fc", corners, face_normals(vertices, model.mesh_face))
    assert cosines.min() >= math.cos(math.pi / CIRCLE_SEGMENTS) - 1e-4
