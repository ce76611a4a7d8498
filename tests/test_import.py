"""`import duobench` registers the environments and does nothing else."""

import json
import os

import pytest

from duobench.tasks import catalog
from tests.children import ran

# Runs in a child process. Everything that the import does to the outside is seen by an audit
# hook; byte code is not written, so that every file opened for writing is the package's own doing.
PROBE = """
import json, os, sys
import numpy, gymnasium
import logging
touched = []
def watch(event, arguments):
    if event == "open":
        mode, flags = arguments[1], arguments[2]
        writes = os.O_WRONLY | os.O_RDWR | os.O_CREAT
        if (flags or 0) & writes or any(letter in (mode or "") for letter in "wax+"):
            touched.append(f"open {arguments[0]}")
    elif event.split(".")[0] in {"socket", "subprocess", "tempfile", "shutil", "urllib"}:
        touched.append(event)
    elif event.startswith("os.") and event not in {"os.listdir", "os.scandir"}:
        touched.append(event)
before = set(sys.modules)
environment = dict(os.environ)
handlers = len(logging.getLogger().handlers)
level = logging.getLogger().level
sys.addaudithook(watch)
import duobench
done = list(touched)
print(json.dumps({
    "modules": sorted(set(sys.modules) - before),
    "touched": done,
    "environment": dict(os.environ) == environment,
    "handlers": [str(handler) for handler in logging.getLogger("duobench").handlers
                 if not isinstance(handler, logging.NullHandler)],
    "root": (len(logging.getLogger().handlers), logging.getLogger().level) == (handlers, level),
    "ids": sorted(name for name in gymnasium.registry if name.startswith("duobench/")),
    "entry_points": [str(spec.entry_point) for name, spec in gymnasium.registry.items()
                     if name.startswith("duobench/") and not isinstance(spec.entry_point, str)],
}))
"""


HEAVY = {
    "mujoco",
    "OpenGL",
    "glfw",
    "matplotlib",
    "trimesh",
    "coacd",
    "manifold3d",
    "mink",
    "PIL",
    "av",
    "scipy",
}


@pytest.fixture(scope="module")
def probed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """Import the package in a fresh process, with an empty home, and report what happened."""
    folder = tmp_path_factory.mktemp("home")
    home = {**os.environ, "HOME": str(folder), "XDG_CACHE_HOME": str(folder)}
    result = ran("-B", "-W", "error", "-c", PROBE, cwd=folder, env=home)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    assert list(folder.iterdir()) == []
    return json.loads(result.stdout)


def test_import_leaves_heavy_packages_and_the_simulation_alone(
    probed: dict[str, list[str]],
) -> None:
    assert "duobench" in probed["modules"]
    assert {module.split(".")[0] for module in probed["modules"]} & HEAVY == set()
    rooms = {module.split(".")[1] for module in probed["modules"] if module.startswith("duobench.")}
    assert rooms.isdisjoint({"scene", "sim", "stages", "experts", "evaluation"})
    tasks = {module for module in probed["modules"] if module.startswith("duobench.tasks.")}
    assert tasks == {"duobench.tasks.catalog"}, "the list of ids is all that is needed"


def test_import_registers_every_task(probed: dict[str, list[str]]) -> None:
    assert probed["ids"] == sorted(f"duobench/{name}-v1" for name in catalog.names())
    assert probed["ids"]
    assert probed["entry_points"] == [], "an entry point is a string, loaded when it is needed"


def test_import_touches_nothing_outside_and_no_setting_of_the_process(
    probed: dict[str, list[str]],
) -> None:
    assert probed["touched"] == []
    assert probed["environment"]
    assert probed["handlers"] == []
    assert probed["root"]
