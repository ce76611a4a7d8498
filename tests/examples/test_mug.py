"""The example of a task with an object from a file."""

import json
import os
import runpy
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from duobench.cli import main
from duobench.core.files import checksum
from duobench.tasks import catalog
from tests.children import printed
from tests.docs.markdown import ROOT
from tests.task_harness import TaskHarness

trimesh = pytest.importorskip("trimesh")  # the environment of LeRobot has none

EXAMPLE = ROOT / "examples" / "mug"
TASK = "mug_on_coaster:TASK"
MODEL = """
import hashlib, sys
import duobench
env = duobench.make("mug_on_coaster:TASK", cameras=False)
env.reset(seed=0)
model = env.unwrapped.simulation.model
arrays = [getattr(model, name) for name in dir(model) if not name.startswith("_")]
digest = hashlib.sha256()
for array in arrays:
    if hasattr(array, "tobytes"):
        digest.update(array.tobytes())
print(digest.hexdigest(), env.get_wrapper_attr("state_hash")())
print({"trimesh", "coacd"} & sys.modules.keys())
"""


@pytest.fixture
def example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the example, as a task that can be imported from another folder."""
    folder = shutil.copytree(EXAMPLE, tmp_path / "example")
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "mug_on_coaster", raising=False)
    return folder


def test_its_mesh_is_what_its_code_makes(example: Path) -> None:
    (example / "mug.stl").unlink()
    runpy.run_path(str(example / "make_mug.py"), run_name="__main__")
    assert (example / "mug.stl").read_bytes() == (EXAMPLE / "mug.stl").read_bytes()


def test_its_expert_solves_it(example: Path) -> None:
    del example
    play = TaskHarness(catalog.get(TASK))
    script: Callable[..., Any] = sys.modules["mug_on_coaster"].script
    for seed in (0, 1):
        play.start(seed)
        assert play.run_for(script, play.task.horizon) == play.task.max_stage, play.history


@pytest.mark.slow
def test_it_has_the_same_bits_on_every_kernel_and_needs_no_extra(example: Path) -> None:
    paths = {"PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(example)])}
    environment = {**os.environ, **paths}
    found = {
        printed(MODEL, env={**environment, "OPENBLAS_CORETYPE": kernel})
        for kernel in ("Haswell", "SkylakeX", "Prescott")
    }
    (only,) = found
    assert only.endswith("set()\n")


def test_its_mug_is_printed_as_it_is(example: Path) -> None:
    main(["print", TASK, "--out", "prints"])
    folder = example.parent / "prints" / "mug_on_coaster"
    given, made = (trimesh.load_mesh(path) for path in (example / "mug.stl", folder / "mug.stl"))
    assert made.is_watertight
    assert made.extents == pytest.approx(given.extents, abs=1e-4)
    assert made.volume == pytest.approx(given.volume, rel=1e-4)


def test_another_mug_is_another_run(example: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["eval", "--policy", "hold", "--tasks", TASK, "--out", "run", "--episodes", "1"]
    words += ["--workers", "0", "--videos", "0"]
    main(words)
    prepared = example / "mug.stl.parts.json"
    document = json.loads(prepared.read_text(encoding="utf-8"))
    document["parts"].pop()
    document["sha256"] = checksum(document)
    prepared.write_text(json.dumps(document), encoding="utf-8")
    del sys.modules["mug_on_coaster"]
    capsys.readouterr()
    with pytest.raises(SystemExit, match=f"source of objects of {TASK}"):
        main(words)
