"""Objects from files of meshes: prepared once, then read; what is none is refused."""

from __future__ import annotations

import importlib
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image as Pillow, ImageColor

from duobench.core.errors import AssetError, DuoBenchError, TaskError, UnknownNameError
from duobench.tasks import RED, mesh_object
from duobench.world.objects import mass_properties, printable
from duobench.world.objects.mesh_file import MOST_TRIANGLES
from duobench.world.objects.prop import Prop, digest_of
from duobench.world.objects.solid import manifold_from
from duobench.world.scene.compose import compose
from tests.children import environment, ran

EDGES = np.array([30.0, 40.0, 50.0])
BOX = trimesh.creation.box(EDGES)
BOX.apply_translation((100.0, -20.0, 7.0))
VERTICES, FACES = np.array(BOX.vertices), np.array(BOX.faces)


def stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    return trimesh.Trimesh(vertices, faces, process=False).export(file_type="stl")


def obj(vertices: np.ndarray, faces: np.ndarray, before: str = "") -> bytes:
    lines = [f"v {x} {y} {z}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return "\n".join([before, *lines, ""]).encode()


def glb() -> bytes:
    """Two boxes in metres, y up, one on the other: each a node with a pose, and a colour."""
    scene = trimesh.Scene()
    for number, colour in enumerate([(255, 0, 0, 255), (0, 255, 0, 255)]):
        half = trimesh.creation.box([0.03, 0.025, 0.04])
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=colour)
        half.visual = trimesh.visual.TextureVisuals(material=material)
        pose = trimesh.transformations.translation_matrix([0.2, 0.025 * number, 0.1])
        scene.add_geometry(half, node_name=f"half {number}", transform=pose)
    return scene.export(file_type="glb")


TEXT = trimesh.exchange.stl.export_stl_ascii(BOX).encode()
FORMATS = {
    "box.stl": (stl(VERTICES, FACES), "mm"),
    "Würfel 1.STL": (b"solid W\xfcrfel" + TEXT[TEXT.index(b"\n") :], "mm"),
    "box.obj": (obj(VERTICES / 10, FACES, "# W\xfcrfel"), "cm"),
    "box.glb": (glb(), None),
    "inside out.stl": (stl(VERTICES, FACES[:, ::-1]), "mm"),
}


def made(folder: Path, name: str, content: bytes, **options: Any) -> Prop:
    path = folder / name
    path.write_bytes(content)
    return mesh_object(path, **{"units": "mm", **options})


@pytest.mark.parametrize("name", FORMATS)
def test_a_box_of_any_format_is_the_same(tmp_path: Path, name: str) -> None:
    content, units = FORMATS[name]
    prop = made(tmp_path, name, content, units=units, mass=0.12)
    assert prop.name == Path(name).stem
    vertices = printable(prop.solid).vertices
    assert vertices.min(axis=0) == pytest.approx([-0.015, -0.02, 0.0], abs=1e-6)
    assert vertices.max(axis=0) == pytest.approx([0.015, 0.02, 0.05], abs=1e-6)
    weighed = mass_properties(prop.solid)
    assert weighed.mass == pytest.approx(0.12)
    assert weighed.centre == pytest.approx([0, 0, 0.025], abs=1e-6)
    corners = np.vstack([shape.corners() for shape in prop.solid.shapes])
    assert np.ptp(corners, axis=0) == pytest.approx(EDGES / 1000, rel=0.01)
    assert compose((prop,)).compile().body(prop.name).mass == pytest.approx(0.12)


def test_an_axis_of_the_file_may_point_up(tmp_path: Path) -> None:
    prop = made(tmp_path, "box.obj", obj(VERTICES, FACES), up="y")
    edges = np.ptp(printable(prop.solid).vertices, axis=0)
    assert edges == pytest.approx([0.03, 0.05, 0.04])


def test_colours_of_a_scene_are_kept_unless_one_is_given(tmp_path: Path) -> None:
    own = made(tmp_path, "box.glb", glb(), units=None).solid
    assert [image.rgba[:2] for image in own.images] == [(1.0, 0.0), (0.0, 1.0)]
    given = made(tmp_path, "box.glb", glb(), units=None, rgba=RED).solid
    assert {image.rgba for image in given.images} == {RED}


def textured(folder: Path, colour: str) -> Path:
    """A box with a picture on its front, in a material of its own beside it."""
    uv = "vt 0 0\nvt 1 0\nvt 1 1\n"
    before = f"mtllib box.mtl\nusemtl skin\n{uv}"
    text = obj(VERTICES, FACES, before).decode()
    text = "\n".join(
        "f " + " ".join(f"{n}/{i}" for i, n in enumerate(line.split()[1:], 1))
        if line.startswith("f ")
        else line
        for line in text.splitlines()
    )
    (folder / "box.obj").write_text(text)
    (folder / "box.mtl").write_text("newmtl skin\nKd 0.1 0.1 0.1\nmap_Kd maps\\skin.png\n")
    picture = Pillow.new("RGB", (8, 4), colour)
    picture.putpixel((0, 3), (0, 0, 255))
    (folder / "maps").mkdir(exist_ok=True)
    picture.save(folder / "maps" / "skin.png")
    return folder / "box.obj"


def test_textures_are_kept_and_belong_to_what_is_prepared(tmp_path: Path) -> None:
    digests = []
    for colour in ("red", "green"):
        prop = mesh_object(textured(tmp_path, colour), units="mm")
        (image,) = prop.solid.images
        assert image.texture is not None
        assert image.texture.texels[0, 0].tolist() == list(ImageColor.getrgb(colour))
        # The first texture coordinate is the lower left corner of the picture.
        corner = image.texture.corners[0]
        assert corner.tolist() == [0.0, 1.0]
        assert image.texture.texels[3, 0].tolist() == [0, 0, 255]
        model = compose((prop,)).compile()
        geom = model.geom("box:image0")
        assert model.mat_texid[geom.matid[0]].max() >= 0
        assert model.mesh(geom.dataid[0]).texcoordadr[0] >= 0
        digests.append(digest_of((prop,)))
    assert digests[0] != digests[1]
    Pillow.new("RGB", (4000, 10)).save(tmp_path / "other.png")
    other = mesh_object(tmp_path / "box.obj", units="mm", texture=tmp_path / "other.png")
    assert other.solid.images[0].texture.texels.shape == (3, 1024, 3)  # type: ignore[union-attr]
    with pytest.raises(TaskError, match="no texture coordinates"):
        made(tmp_path, "box.stl", stl(VERTICES, FACES), texture=tmp_path / "other.png").solid  # noqa: B018


def test_it_is_prepared_once_and_then_only_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prop = made(tmp_path, "box.stl", stl(VERTICES, FACES))
    first = digest_of((prop,))
    (saved,) = tmp_path.glob("*.json")
    assert saved.name == "box.stl.parts.json"
    content = saved.read_bytes()
    monkeypatch.setitem(sys.modules, "coacd", None)
    again = mesh_object(tmp_path / "box.stl", units="mm")
    assert digest_of((again,)) == first
    for wrong in (content[:-40], content.replace(b"85.0", b"85.5"), b"", b"[]"):
        saved.write_bytes(wrong)
        with pytest.raises(AssetError, match=r"needs trimesh and CoACD .*\[objects\]"):
            mesh_object(tmp_path / "box.stl", units="mm").solid  # noqa: B018
    saved.write_bytes(content)
    made(tmp_path, "box.stl", stl(VERTICES * 1.01, FACES))
    with pytest.raises(AssetError, match="needs trimesh and CoACD"):
        mesh_object(tmp_path / "box.stl", units="mm").solid  # noqa: B018
    monkeypatch.undo()
    other = mesh_object(tmp_path / "box.stl", units="mm")
    assert digest_of((other,)) != first
    assert saved.read_bytes() != content


def test_a_folder_that_cannot_be_written_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The tests' user may write everywhere, so the question gets another answer.
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(AssetError, match="nothing may be written there"):
        made(tmp_path, "box.stl", stl(VERTICES, FACES)).solid  # noqa: B018


@pytest.mark.slow
def test_two_processes_prepare_one_file(tmp_path: Path) -> None:
    import subprocess

    (tmp_path / "box.stl").write_bytes(stl(VERTICES, FACES))
    code = (
        "from duobench.tasks import mesh_object; from duobench.world.objects.prop import digest_of;"
        "print(digest_of((mesh_object('box.stl', units='mm'),)))"
    )
    two = [
        subprocess.Popen(
            [sys.executable, "-c", code],
            cwd=tmp_path,
            env=environment(),
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    one, other = (process.communicate()[0] for process in two)
    assert one == other != ""
    assert {path.name for path in tmp_path.iterdir()} == {"box.stl", "box.stl.parts.json"}


def test_a_relative_path_begins_beside_its_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "box.stl").write_bytes(stl(VERTICES, FACES))
    (tmp_path / "lib" / "uses_box.py").write_text(
        "from duobench.tasks import mesh_object\nBOX = mesh_object('box.stl', units='mm')\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path / "lib"))
    monkeypatch.chdir(tmp_path)
    prop = importlib.import_module("uses_box").BOX
    monkeypatch.chdir("/")
    assert len(prop.solid.shapes) == 1
    with pytest.raises(AssetError, match=r"no file .*world/objects/box\.stl; a relative path"):
        mesh_object("box.stl", units="mm")


def shells(*meshes: trimesh.Trimesh) -> bytes:
    return trimesh.util.concatenate(meshes).export(file_type="stl")


def test_shells_that_overlap_are_one_body(tmp_path: Path) -> None:
    moved = BOX.copy().apply_translation((15.0, 0.0, 0.0))
    prop = made(tmp_path, "two.stl", shells(BOX, moved), mass=0.1)
    assert manifold_from(printable(prop.solid)).volume() == pytest.approx(1.5 * 60e-6, rel=1e-5)


@pytest.mark.slow
def test_a_hollow_is_not_filled(tmp_path: Path) -> None:
    hollow = trimesh.creation.box([10.0, 10.0, 10.0]).apply_translation((100.0, -20.0, 7.0))
    hollow.invert()
    prop = made(tmp_path, "hollow.stl", shells(BOX, hollow))
    assert mass_properties(prop.solid).mass == pytest.approx(1240 * 59e-6, rel=1e-4)


def nodes(count: int) -> bytes:
    """A GLB whose one mesh is used many times over."""
    scene = trimesh.Scene()
    ball = trimesh.creation.icosphere(4)
    for number in range(count):
        scene.add_geometry(ball, geom_name="ball", node_name=str(number))
    return scene.export(file_type="glb")


HOLE = r"has holes, or faces that meet"
NONE = r"has 0 triangles; an object has 1 to"
REFUSED: dict[str, tuple[Callable[[], bytes], str]] = {
    "empty.stl": (lambda: b"", NONE),
    "text.stl": (lambda: b"hello", NONE),
    "cut.stl": (lambda: stl(VERTICES, FACES)[:300], NONE),
    "long.stl": (lambda: b"\0" * 80 + struct.pack("<I", 2**32 - 1) + b"\0" * 50, NONE),
    "is obj.stl": (lambda: obj(VERTICES, FACES), NONE),
    "is stl.obj": (lambda: stl(VERTICES, FACES), NONE),
    "is stl.glb": (lambda: stl(VERTICES, FACES), "no valid GLB file"),
    "junk.glb": (lambda: b"glTF" + b"\xff" * 90, "no valid GLB file"),
    "points.obj": (lambda: obj(VERTICES, FACES[:0]), NONE),
    "open.stl": (lambda: stl(VERTICES, FACES[:-2]), HOLE),
    "mixed.stl": (lambda: stl(VERTICES, np.vstack([FACES[:6], FACES[6:, ::-1]])), HOLE),
    "nan.obj": (lambda: obj(VERTICES, FACES).replace(b"85.0", b"nan"), "flat, or without"),
    "far.obj": (lambda: obj(VERTICES, FACES).replace(b"85.0", b"1e300"), "flat, or without"),
    "index.obj": (lambda: obj(VERTICES, FACES + 100), "no valid OBJ file"),
    "flat.obj": (lambda: obj(VERTICES * (1, 1, 0), FACES), "flat"),
    "point.obj": (lambda: obj(VERTICES * 0, FACES), "flat"),
    "no.obj": (lambda: obj(VERTICES, FACES, "mtllib no.mtl"), r"refers to no\.mtl, missing"),
    "out.obj": (lambda: obj(VERTICES, FACES, "mtllib ../../no.mtl"), r"refers to \.\./\.\./no"),
    "many.glb": (lambda: nodes(30), rf"triangles; an object has 1 to {MOST_TRIANGLES}"),
    "fan.stl": (
        lambda: trimesh.creation.cylinder(9, 9, sections=1500).export(file_type="stl"),
        "around a corner",
    ),
}


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_closed_mesh_is_refused(tmp_path: Path, name: str) -> None:
    content, reason = REFUSED[name]
    with pytest.raises(AssetError, match=reason):
        made(tmp_path, name, content(), mass=0.1).solid  # noqa: B018
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_large_file_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "large.obj").open("wb") as file:
        file.truncate(10**9)
    with pytest.raises(AssetError, match="has 1000 MB, and may have 64"):
        mesh_object(tmp_path / "large.obj", units="mm").solid  # noqa: B018


def test_sizes_in_another_unit_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TaskError, match=r"50 m long, read in m, .* It would be 0\.05 m in mm"):
        made(tmp_path, "box.stl", stl(VERTICES, FACES), units="m").solid  # noqa: B018
    with pytest.raises(TaskError, match=r"is 5e-05 m long, read in mm"):
        made(tmp_path, "small.obj", obj(VERTICES / 1000, FACES)).solid  # noqa: B018


WRONG: list[tuple[dict[str, Any], type[DuoBenchError], str]] = [
    ({"units": None}, TaskError, "does not say its unit"),
    ({"units": "feet"}, UnknownNameError, "unit 'feet'"),
    ({"up": "x"}, UnknownNameError, "axis 'x'"),
    ({"mass": 150.0}, TaskError, "in kg, above 0 and at most 20; got 150"),
    ({"mass": -1.0}, TaskError, "in kg"),
    ({"mass": "0.1"}, TaskError, "in kg"),
    ({"mass": float("nan")}, TaskError, "in kg"),
    ({"mass": True}, TaskError, "in kg"),
    ({"rgba": (255, 0, 0, 255)}, TaskError, "colour"),
    ({"texture": "no.png"}, AssetError, "no file"),
]


@pytest.mark.parametrize(("options", "error", "reason"), WRONG)
def test_wrong_arguments_are_refused(
    tmp_path: Path, options: dict[str, Any], error: type[DuoBenchError], reason: str
) -> None:
    with pytest.raises(error, match=reason):
        made(tmp_path, "box.stl", stl(VERTICES, FACES), **options).solid  # noqa: B018


def test_other_formats_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TaskError, match=r"ends in none of \.stl, \.obj, \.glb"):
        made(tmp_path, "box.ply", b"")


def test_importing_tasks_loads_neither_library() -> None:
    code = "import sys, duobench.tasks; duobench.tasks.mesh_object, duobench.tasks.mjcf_object\n"
    code += "assert not {'trimesh', 'coacd', 'PIL.Image'} & sys.modules.keys()"
    done = ran("-c", code, env=environment())
    assert done.returncode == 0, done.stderr
