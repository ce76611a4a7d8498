"""The shipped meshes of the robot are those of the recipes, made from the published files."""

import hashlib
import re
from pathlib import Path

import numpy as np

from dev.tools import meshes
from dev.tools.fine_meshes import RECIPES
from duobench.world.scene.meshes import robot_meshes

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
    assert sorted(found) == sorted(names)
    for group in meshes.VISUAL_GROUPS:
        faces = sum(len(found[f"{name}:visual"].faces) for name in group.fills_mm)
        assert faces <= group.triangles + meshes.MOST_ADDED
    for name, vertices in meshes.VISUAL_OUTLINES.items():
        # A point on a sharp edge is there once for each side.
        assert len(np.unique(found[f"{name}:visual"].vertices, axis=0)) == vertices
    assert all(len(found[f"{name}:hull"].vertices) <= meshes.HULL_VERTICES for name in meshes.HULLS)


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
