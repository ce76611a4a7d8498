"""The meshes of the robot: the file in the package, and what MuJoCo makes of it; and normals."""

import math
from importlib import resources

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from duobench.core.errors import AssetError, UnknownNameError
from duobench.world.objects.bowl import bowl
from duobench.world.objects.shapes import CIRCLE_SEGMENTS, box, cylinder
from duobench.world.objects.solid import Mesh, manifold_of, mesh_of, printable
from duobench.world.robot.frames import robot_with
from duobench.world.scene import meshes
from duobench.world.scene.compose import compose
from duobench.world.scene.meshes import (
    FLAT,
    add_mesh,
    add_visual_mesh,
    corner_normals,
    decode,
    robot_meshes,
)

NAMES = sorted(robot_meshes())
HULLS = [name for name in NAMES if name.endswith(":hull")]
# Two arms and two grippers, of whose fingers each part is there twice.
FINGER_PARTS = ("driver", "coupler", "spring_link", "follower", "tongue", "finger", "tip")
KINDS = {"robotiq_2f85": "robotiq_2f85/", "franka_hand": "franka_hand/"}
"""Beginnings of the names of meshes, by gripper."""


def of_robot(gripper: str) -> list[str]:
    others = tuple(prefix for kind, prefix in KINDS.items() if kind != gripper)
    return [name for name in NAMES if not name.startswith(others)]


def shipped() -> bytes:
    return resources.files("duobench.world.scene").joinpath(meshes.FILE).read_bytes()


def copies(name: str) -> int:
    return 4 if name.removesuffix(":visual").endswith(FINGER_PARTS) else 2


def areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Normals of triangles, twice as long as their areas."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    normals = areas(vertices, faces)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize(
    ("gripper", "count", "points", "triangles", "drawn"),
    [("robotiq_2f85", 38, 3212, 3124, 5850), ("franka_hand", 28, 2692, 3234, 6360)],
)
def test_the_file_holds_the_meshes_of_a_robot(
    gripper: str, count: int, points: int, triangles: int, drawn: int
) -> None:
    found = {name: robot_meshes()[name] for name in of_robot(gripper)}
    assert len(found) == count
    assert sum(len(mesh.vertices) for mesh in found.values()) == points
    assert sum(len(mesh.faces) for mesh in found.values()) == triangles
    total = sum(copies(name) * len(found[name].faces) for name in found if name not in HULLS)
    assert total <= drawn, "triangles of two arms and grippers"


@pytest.mark.parametrize("share", [0.0, 0.001, 0.25, 0.5, 0.75, 0.999])
def test_a_flipped_bit_or_an_end_anywhere_is_found(share: float) -> None:
    data = bytearray(shipped())
    place = int(len(data) * share)
    with pytest.raises(AssetError, match="Install duobench again"):
        decode(bytes(data[:place]))
    data[place] ^= 1
    with pytest.raises(AssetError, match="damaged"):
        decode(bytes(data))


def test_meshes_are_read_once_from_a_file_that_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    assert robot_meshes() is robot_meshes()
    monkeypatch.setattr(meshes, "FILE", "no_such_file.npz")
    with pytest.raises(AssetError, match=r"no_such_file\.npz"):
        robot_meshes.__wrapped__()


@pytest.mark.parametrize("name", NAMES)
def test_every_vertex_is_used_and_every_triangle_has_an_area(name: str) -> None:
    mesh = robot_meshes()[name]
    vertices, faces = mesh.vertices, mesh.faces
    assert (vertices.flags.writeable, faces.flags.writeable) == (False, False)
    assert (vertices.dtype, faces.dtype) == (np.float64, np.int32)
    assert sorted(set(faces.ravel().tolist())) == list(range(len(vertices)))
    assert areas(vertices, faces).any(axis=1).all()


@pytest.mark.parametrize("name", HULLS)
def test_a_hull_is_small_closed_and_convex(name: str) -> None:
    mesh = robot_meshes()[name]
    vertices, faces = mesh.vertices, mesh.faces
    assert len(vertices) <= 24
    edges = {(face[k], face[k - 2]) for face in faces.tolist() for k in range(3)}
    assert edges == {(end, start) for start, end in edges}
    # Positive where the triangles face outward.
    volume = np.einsum("ij,ij->", vertices[faces[:, 0]], areas(vertices, faces)) / 6
    assert volume == pytest.approx(ConvexHull(vertices).volume, rel=1e-6)


@pytest.mark.parametrize("gripper", KINDS)
def test_the_robot_uses_every_mesh_and_no_other(gripper: str) -> None:
    model = compose((), robot=robot_with(gripper)).compile()
    triangles = {
        model.mesh(number).name: int(model.mesh_facenum[number]) for number in range(model.nmesh)
    }
    used = {name: n for name, n in triangles.items() if name.endswith((":visual", ":hull"))}
    assert used == {name: len(robot_meshes()[name].faces) for name in of_robot(gripper)}


def test_a_mesh_is_added_once_and_an_unknown_one_is_rejected_with_the_near_ones() -> None:
    spec = mujoco.MjSpec()
    geoms = [add_mesh(spec, spec.worldbody, NAMES[0]) for _ in range(2)]
    assert [geom.meshname for geom in geoms] == [NAMES[0]] * 2
    assert [mesh.name for mesh in spec.meshes] == [NAMES[0]]
    with pytest.raises(UnknownNameError, match="'fr3/link1:hull'"):
        add_mesh(spec, spec.worldbody, "fr3/link1:hul")


# --- normals of visual meshes ------------------------------------------------------------------

MESHES = {
    "box": mesh_of(manifold_of(box(0.1, 0.2, 0.3))),
    "cylinder": mesh_of(manifold_of(cylinder(0.1, 0.2))),
    "bowl": printable(bowl((1.0, 1.0, 1.0, 1.0))),
}


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
