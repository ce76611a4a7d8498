import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from duobench.scene.robot import meshes as shipped
from tools.meshes.__main__ import TARGET
from tools.meshes.build import encode
from tools.meshes.geometry import RESOLUTION

ROOT = Path(__file__).parents[3]


def test_the_shipped_meshes_encode_to_the_shipped_bytes() -> None:
    found = dict(reversed(shipped.robot_meshes().items()))
    assert encode(found) == TARGET.read_bytes()


def test_a_changed_mesh_changes_the_bytes() -> None:
    found = {
        name: replace(mesh, vertices=mesh.vertices.copy())
        for name, mesh in shipped.robot_meshes().items()
    }
    moved = next(iter(found.values())).vertices
    moved.setflags(write=True)
    moved[0, 0] += RESOLUTION
    assert encode(found) != TARGET.read_bytes()


def test_the_tool_says_which_originals_are_missing(tmp_path: Path) -> None:
    before = TARGET.read_bytes()
    command = [sys.executable, "-m", "tools.meshes", str(tmp_path), "--write"]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "lacks 33 of 33 originals" in result.stderr
    assert "fr3/link0.stl" in result.stderr
    assert TARGET.read_bytes() == before
