"""The shipped meshes of the robot are those of the recipes, made from the published files."""

import hashlib
import io
import re
from pathlib import Path

import numpy as np

from dev.tools import hand_meshes, meshes
from dev.tools.fine_meshes import RECIPES
from duobench.world.scene.meshes import FILE, robot_meshes, shipped

GROUPED = [name for group in meshes.VISUAL_GROUPS for name in group.fills_mm]
VISUALS = [*GROUPED, *meshes.VISUAL_OUTLINES]


def test_the_published_files_are_those_of_the_recipes() -> None:
    lines = meshes.DIGESTS.read_text().splitlines()
    assert all(re.fullmatch(r"[0-9a-f]{64}  \S+", line) for line in lines)
    assert len({line.split()[0] for line in lines}) == len(lines) == 44
    images = {name + (".obj" if name.startswith("fr3/") else ".stl") for name in VISUALS}
    fine = {name for recipe in RECIPES for files in recipe.values() for name in files}
    assert images < fine
    assert {line.split()[1] for line in lines} == fine | {f"{name}.stl" for name in meshes.HULLS}


def test_every_shipped_mesh_has_one_recipe_and_keeps_to_its_budget() -> None:
    found = robot_meshes()
    names = [*(f"{name}:visual" for name in VISUALS), *(f"{name}:hull" for name in meshes.HULLS)]
    names += [image for recipe in hand_meshes.RECIPES for image in recipe]
    assert sorted(found) == sorted(names)
    for group in meshes.VISUAL_GROUPS:
        faces = sum(len(found[f"{name}:visual"].faces) for name in group.fills_mm)
        assert faces <= group.triangles + meshes.MOST_ADDED
    for name, vertices in meshes.VISUAL_OUTLINES.items():
        # A point on a sharp edge is there once for each side.
        assert len(np.unique(found[f"{name}:visual"].vertices, axis=0)) == vertices
    assert all(len(found[f"{name}:hull"].vertices) <= meshes.HULL_VERTICES for name in meshes.HULLS)


def test_the_hand_is_made_of_its_published_files_beside_the_others() -> None:
    lines = hand_meshes.DIGESTS.read_text().splitlines()
    used = {name for each in hand_meshes.RECIPES for files in each.values() for name in files}
    assert {line.split()[1] for line in lines} == used
    before = shipped(FILE)
    corner = np.array([[0, 0, 0], [100, 0, 0], [0, 100, 0]])
    assert hand_meshes.with_hand(before, {}) == before
    image = {"franka_hand/tip:visual": (corner, np.array([[0, 1, 2]]))}
    with np.load(io.BytesIO(hand_meshes.with_hand(before, image))) as changed:
        assert changed["counts"][-1].tolist() == [3, 1]
        assert changed["names"].tolist() == [*robot_meshes()]


def test_files_are_found_by_content_and_the_others_named(tmp_path: Path) -> None:
    digests = tmp_path / "digests"
    published = {"fr3/link0.stl": b"one", "fr3/link1.obj": b"two", "fr3/link2.obj": b"three"}
    lines = [f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in published.items()]
    digests.write_text("".join(lines))
    deep = tmp_path / "any" / "layout"
    deep.mkdir(parents=True)
    (deep / "a.obj").write_bytes(b"two")
    (tmp_path / "b.stl").write_bytes(b"one")
    (tmp_path / "link2.obj").write_bytes(b"three, changed")
    assert meshes.missing(tmp_path, digests) == ["fr3/link2.obj"]
