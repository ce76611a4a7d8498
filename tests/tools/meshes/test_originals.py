import hashlib
import re
from pathlib import Path

import pytest

from duobench.errors import AssetError
from tools.meshes import recipes
from tools.meshes.originals import DIGESTS, originals

CONTENT = {"fr3/link0.stl": b"one", "fr3/link1.obj": b"two"}


@pytest.fixture
def digests(tmp_path: Path) -> Path:
    lines = [f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in CONTENT.items()]
    path = tmp_path / "originals.sha256"
    path.write_text("".join(lines))
    return path


def test_the_list_names_exactly_the_files_of_the_recipes() -> None:
    lines = DIGESTS.read_text().splitlines()
    assert all(re.fullmatch(r"[0-9a-f]{64}  \S+", line) for line in lines)
    assert len({line.split()[0] for line in lines}) == len(lines) == 33
    assert {line.split()[1] for line in lines} == {*recipes.VISUAL.values(), *recipes.HULL.values()}


def test_a_mesh_for_images_has_one_recipe() -> None:
    grouped = [name for group in recipes.VISUAL_GROUPS for name in group.fills_mm]
    assert sorted([*grouped, *recipes.VISUAL_OUTLINES]) == sorted(recipes.VISUAL)


def test_files_are_found_by_content_wherever_they_are(digests: Path, tmp_path: Path) -> None:
    deep = tmp_path / "any" / "layout"
    deep.mkdir(parents=True)
    (deep / "a.obj").write_bytes(b"two")
    (tmp_path / "any" / "b.stl").write_bytes(b"one")
    (tmp_path / "any" / "c.stl").write_bytes(b"something else")
    assert originals(tmp_path / "any", digests) == CONTENT


def test_a_missing_or_changed_file_is_named(digests: Path, tmp_path: Path) -> None:
    (tmp_path / "link0.stl").write_bytes(b"one")
    (tmp_path / "link1.obj").write_bytes(b"two, changed")
    with pytest.raises(AssetError, match=r"lacks 1 of 2 originals.*: fr3/link1\.obj\."):
        originals(tmp_path, digests)
