"""The robot's meshes: the file in the package, and what MuJoCo makes of it."""

from importlib import resources

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from duobench.errors import AssetError, UnknownNameError
from duobench.objects import Mesh
from duobench.scene import meshes
from duobench.scene.compose import compose
from duobench.scene.meshes import add_mesh, decode, robot_meshes

NAMES = sorted(robot_meshes())
HULLS = [name for name in NAMES if name.endswith(":hull")]
# Two arms and two grippers, of whose fingers each part is there twice.
FINGER_PARTS = ("driver", "coupler", "spring_link", "follower", "tongue")


def shipped() -> bytes:
    return resources.files("duobench.scene").joinpath(meshes.FILE).read_bytes()


def copies(name: str) -> int:
    return 4 if name.removesuffix(":visual").endswith(FINGER_PARTS) else 2


def volume(mesh: Mesh) -> float:
    """Signed volume, positive where the triangles of a closed mesh face outward."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def test_the_file_holds_25_meshes_for_images_and_13_hulls() -> None:
    found = robot_meshes()
    assert (len(found), len(HULLS)) == (38, 13)
    assert sum(len(mesh.vertices) for mesh in found.values()) == 3168
    assert sum(len(mesh.faces) for mesh in found.values()) == 3068


@pytest.mark.parametrize("share", [0.0, 0.001, 0.25, 0.5, 0.75, 0.999])
def test_a_flipped_bit_anywhere_is_found(share: float) -> None:
    data = bytearray(shipped())
    data[int(len(data) * share)] ^= 1
    with pytest.raises(AssetError, match="damaged"):
        decode(bytes(data))


@pytest.mark.parametrize("share", [0.0, 0.5, 0.999])
def test_a_truncated_file_is_found(share: float) -> None:
    data = shipped()
    with pytest.raises(AssetError, match="Install duobench again"):
        decode(data[: int(len(data) * share)])


def test_a_missing_file_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshes, "FILE", "no_such_file.npz")
    with pytest.raises(AssetError, match=r"no_such_file\.npz"):
        robot_meshes.__wrapped__()


def test_meshes_are_read_once_and_cannot_be_written_to() -> None:
    assert robot_meshes() is robot_meshes()
    mesh = robot_meshes()[NAMES[0]]
    for array in (mesh.vertices, mesh.faces):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1


@pytest.mark.parametrize("name", NAMES)
def test_every_vertex_is_used_and_every_triangle_has_an_area(name: str) -> None:
    mesh = robot_meshes()[name]
    vertices, faces = mesh.vertices, mesh.faces
    assert (vertices.dtype, faces.dtype) == (np.float64, np.int32)
    assert sorted(set(faces.ravel().tolist())) == list(range(len(vertices)))
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    assert (np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0).all()


@pytest.mark.parametrize("name", HULLS)
def test_a_hull_is_small_closed_and_convex(name: str) -> None:
    mesh = robot_meshes()[name]
    vertices, faces = mesh.vertices, mesh.faces
    assert len(vertices) <= 24
    edges = {(face[k], face[k - 2]) for face in faces.tolist() for k in range(3)}
    assert edges == {(end, start) for start, end in edges}
    assert volume(mesh) == pytest.approx(ConvexHull(vertices).volume, rel=1e-6)


def test_two_arms_and_grippers_stay_within_5800_triangles() -> None:
    found = robot_meshes()
    total = sum(copies(name) * len(found[name].faces) for name in NAMES if name not in HULLS)
    assert total <= 5800


def test_the_robot_uses_every_mesh_and_no_other() -> None:
    model = compose(()).compile()
    triangles = {
        model.mesh(number).name: int(model.mesh_facenum[number]) for number in range(model.nmesh)
    }
    of_robot = {name: n for name, n in triangles.items() if name.endswith((":visual", ":hull"))}
    assert of_robot == {name: len(mesh.faces) for name, mesh in robot_meshes().items()}


def test_a_mesh_is_added_once() -> None:
    spec = mujoco.MjSpec()
    geoms = [add_mesh(spec, spec.worldbody, NAMES[0]) for _ in range(2)]
    assert [geom.meshname for geom in geoms] == [NAMES[0]] * 2
    assert [mesh.name for mesh in spec.meshes] == [NAMES[0]]


def test_an_unknown_name_is_rejected_with_the_near_ones() -> None:
    spec = mujoco.MjSpec()
    with pytest.raises(UnknownNameError, match="'fr3/link1:hull'"):
        add_mesh(spec, spec.worldbody, "fr3/link1:hul")
