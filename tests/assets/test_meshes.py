"""The door of the store, with the real meshes."""

import shutil
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial import cKDTree

from duobench.assets import derived, meshes, recipes
from duobench.assets.cache import file_path
from duobench.assets.geometry import Mesh, read
from duobench.assets.manifest import manifest
from duobench.errors import UnknownNameError
from tests.assets.shapes import area, normals, open_edges, volume

PREPARE = """
from duobench.assets import derived, meshes
from duobench.assets.cache import cache_dir
meshes.prepare()
made = derived.load(derived.path_in(cache_dir()))
assert made is not None
print(made.digest())
"""

# How often a picture mesh is drawn for two arms and two grippers.
COPIES = dict.fromkeys(meshes.VISUAL_NAMES, 2) | {
    f"robotiq_2f85/{part}": 4 for part in ("driver", "coupler", "spring_link", "follower", "tongue")
}
REDUCED = sorted(set(meshes.VISUAL_NAMES) - set(recipes.VISUAL_OUTLINES))
# Parts that lose pieces on purpose: inlays, plugs and rings behind other parts.
OPEN_PARTS = {"fr3/link0_3", "fr3/link0_6", "fr3/link3_0", "fr3/link4_0", "fr3/link5_2"} | {
    f"fr3/link{part}" for part in ("6_2", "6_6", "7_1", "7_2", "7_3")
}


def samples(mesh: Mesh, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points spread evenly over the triangles, and the unit normals there."""
    normal = normals(mesh)
    size = np.linalg.norm(normal, axis=1) / 2
    random = np.random.default_rng(0)
    face = random.choice(len(size), size=int(size.sum() / spacing**2) + 100, p=size / size.sum())
    u, v = np.sqrt(random.uniform(size=len(face))), random.uniform(size=len(face))
    weights = np.stack([1 - u, u * (1 - v), u * v], axis=1)
    points = (mesh.vertices[mesh.faces[face]] * weights[:, :, None]).sum(axis=1)
    return points, normal[face] / (2 * size[face, None])


def published(cache: Path, name: str) -> Mesh:
    file = manifest().files[name]
    return read(name, file_path(cache, file).read_bytes())


@pytest.fixture
def filled(filled_cache, monkeypatch):
    monkeypatch.setenv("DUOBENCH_CACHE", str(filled_cache))
    monkeypatch.delenv("DUOBENCH_ASSETS", raising=False)
    return filled_cache


@pytest.fixture
def raw_copy(filled_cache, tmp_path, monkeypatch):
    """A cache that holds the published files, and nothing made from them."""
    cache = tmp_path / "cache"
    shutil.copytree(filled_cache / "files", cache / "files")
    monkeypatch.setenv("DUOBENCH_CACHE", str(cache))
    monkeypatch.delenv("DUOBENCH_ASSETS", raising=False)
    return cache


def test_the_derived_meshes_are_the_reference_to_the_last_bit(mesh_set):
    assert mesh_set.digest() == manifest().reference_sha256


def test_every_name_gives_its_mesh(filled, mesh_set):
    del filled
    assert len(meshes.VISUAL_NAMES) == 25
    assert len(meshes.HULL_NAMES) == 15
    for name in meshes.VISUAL_NAMES:
        np.testing.assert_array_equal(meshes.visual(name).faces, mesh_set.visual[name].faces)
    for name in meshes.HULL_NAMES:
        np.testing.assert_array_equal(meshes.hull(name).vertices, mesh_set.hull[name].vertices)


def test_an_unknown_name_is_refused_with_the_near_ones():
    with pytest.raises(UnknownNameError, match="fr3/link1"):
        meshes.visual("fr3/link1_")
    with pytest.raises(UnknownNameError, match="robotiq_2f85/driver"):
        meshes.hull("robotiq_2f85/drivers")


def test_two_arms_and_grippers_stay_within_5800_triangles(mesh_set):
    total = sum(COPIES[name] * len(mesh.faces) for name, mesh in mesh_set.visual.items())
    assert total <= 5800
    for group in recipes.VISUAL_GROUPS:
        assert sum(len(mesh_set.visual[name].faces) for name in group.fills_mm) <= group.triangles


@pytest.mark.parametrize("name", REDUCED)
def test_a_picture_lies_on_the_published_surface_and_faces_the_same_way(
    filled_cache, mesh_set, name
):
    original = published(filled_cache, recipes.VISUAL[name])
    points, directions = samples(original, spacing=0.0015)
    tree = cKDTree(points)
    light = mesh_set.visual[name]
    spikes, _ = tree.query(light.vertices)
    assert spikes.max() < 0.008
    at, towards = samples(light, spacing=0.0015)
    distance, nearest = tree.query(at, k=12)
    assert np.percentile(distance[:, 0], 95) < 0.004
    # On a thin wall the nearest points lie on both sides: one of them has to agree.
    agrees = ((directions[nearest] * towards[:, None]).sum(axis=-1) > 0).any(axis=1)
    assert agrees.mean() > 0.98


@pytest.mark.parametrize("name", recipes.VISUAL_OUTLINES)
def test_an_outline_keeps_the_extent(filled_cache, mesh_set, name):
    original = published(filled_cache, recipes.VISUAL[name]).vertices
    light = mesh_set.visual[name]
    np.testing.assert_allclose(light.vertices.min(axis=0), original.min(axis=0), atol=0.002)
    np.testing.assert_allclose(light.vertices.max(axis=0), original.max(axis=0), atol=0.002)
    assert open_edges(light) == 0


@pytest.mark.parametrize("name", sorted(set(REDUCED) - OPEN_PARTS))
def test_a_whole_part_has_no_hole(filled_cache, mesh_set, name):
    original = published(filled_cache, recipes.VISUAL[name])
    light = mesh_set.visual[name]
    missing, _ = cKDTree(samples(light, spacing=0.0015)[0]).query(samples(original, 0.002)[0])
    assert np.percentile(missing, 99) < 0.01
    assert area(light) > 0.6 * area(original)


@pytest.mark.parametrize(
    ("white", "black"), [("fr3/link3_0", "fr3/link3_1"), ("fr3/link5_0", "fr3/link5_2")]
)
def test_shell_and_band_share_their_border(mesh_set, white, black):
    first, second = mesh_set.visual[white], mesh_set.visual[black]
    both = Mesh(
        vertices=np.concatenate([first.vertices, second.vertices]),
        faces=np.concatenate([first.faces, second.faces + len(first.vertices)]),
    )
    assert open_edges(both) < 0.2 * (open_edges(first) + open_edges(second))


@pytest.mark.parametrize("name", meshes.HULL_NAMES)
def test_a_hull_is_small_convex_closed_and_inside_the_shape(filled_cache, mesh_set, name):
    hull = mesh_set.hull[name]
    assert len(hull.vertices) <= 24
    assert open_edges(hull) == 0
    assert volume(hull) > 0
    unit = normals(hull) / np.linalg.norm(normals(hull), axis=1, keepdims=True)
    offset = (unit * hull.vertices[hull.faces[:, 0]]).sum(axis=1)
    assert (unit @ hull.vertices.T - offset[:, None]).max() < 1e-9
    outside = unit @ published(filled_cache, recipes.HULL[name]).vertices.T - offset[:, None]
    assert outside.max() < 0.012


def test_mujoco_takes_every_mesh(mesh_set):
    spec = mujoco.MjSpec()
    for name, mesh in mesh_set.items():
        spec.add_mesh(
            name=name,
            uservert=mesh.vertices.ravel(),
            userface=mesh.faces.ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
    model = spec.compile()
    counts = [len(mesh.faces) for _, mesh in mesh_set.items()]
    assert model.mesh_facenum.tolist() == counts


def test_status_says_what_is_there(filled):
    rows = meshes.status()
    assert len(rows) == len(manifest().files) + 1
    assert {row.state for row in rows} == {"ready"}
    assert all(Path(row.path).is_relative_to(filled) for row in rows)


def test_status_of_an_empty_or_damaged_cache_changes_nothing(sealed):
    assert {row.state for row in meshes.status()} == {"missing"}
    assert not sealed.exists()
    file = next(iter(manifest().files.values()))
    file_path(sealed, file).parent.mkdir(parents=True)
    file_path(sealed, file).write_bytes(b"half")
    derived.path_in(sealed).parent.mkdir(parents=True)
    derived.path_in(sealed).write_bytes(b"half")
    rows = {row.name: row.state for row in meshes.status()}
    assert rows[file.name] == rows["derived meshes"] == "damaged"


def test_a_warm_cache_needs_no_source(filled_cache, sealed):
    shutil.copytree(filled_cache / "derived", sealed / "derived")
    meshes.prepare()
    assert len(meshes.visual("fr3/link1").faces) > 100
    assert not (sealed / "files").exists()


def test_saved_meshes_come_back_equal(mesh_set, tmp_path):
    derived.save(tmp_path / "file.npz", mesh_set)
    loaded = derived.load(tmp_path / "file.npz")
    assert loaded is not None
    assert loaded.digest() == mesh_set.digest()
    for name, mesh in mesh_set.visual.items():
        np.testing.assert_array_equal(loaded.visual[name].vertices, mesh.vertices)
        assert loaded.visual[name].faces.dtype == np.int32


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_truncated_file_counts_as_missing(mesh_set, tmp_path, share):
    path = tmp_path / "file.npz"
    derived.save(path, mesh_set)
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    assert derived.load(path) is None


def test_a_flipped_bit_counts_as_missing(mesh_set, tmp_path):
    path = tmp_path / "file.npz"
    derived.save(path, mesh_set)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    assert derived.load(path) is None


def test_processes_that_start_at_once_make_everything_once(raw_copy):
    derived.path_in(raw_copy).parent.mkdir()
    derived.path_in(raw_copy).write_bytes(b"damaged by a power cut")
    command = [sys.executable, "-c", PREPARE]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    processes = [subprocess.Popen(command, **streams) for _ in range(3)]
    results = [process.communicate() for process in processes]
    assert [process.returncode for process in processes] == [0, 0, 0], results
    assert {out for out, _ in results} == {manifest().reference_sha256 + "\n"}
    assert sum("reducing meshes" in err for _, err in results) == 1
    assert [path.name for path in (raw_copy / "derived").iterdir()] == [
        derived.path_in(raw_copy).name
    ]


def test_importing_the_store_reads_and_fetches_nothing(tmp_path):
    code = (
        "import sys, duobench.assets.meshes as m; "
        "assert not {'rich', 'mujoco_menagerie'} & set(sys.modules), 'imported early'; "
        "print(len(m.VISUAL_NAMES))"
    )
    environment = {"DUOBENCH_CACHE": str(tmp_path / "cache"), "PYTHONPATH": ":".join(sys.path)}
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert result.stdout == "25\n"
    assert list(tmp_path.iterdir()) == []
