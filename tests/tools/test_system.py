"""What make prepares on a machine that is not ours to change: it says in a sentence what lacks."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from duobench.core.machine import OPENGL_PACKAGES
from tests.test_repository import ROOT

VENV = "python{}.{}-venv".format(*sys.version_info)


def prepare(part: str, folder: Path, *missing: str) -> subprocess.CompletedProcess[str]:
    """Prepare for a part where there is no apt, and a Python for which some modules are missing."""
    for name in missing:
        (folder / f"{name}.py").write_text("raise ImportError")
    python = folder / "python"
    python.write_text(f'#!/bin/sh\nPYTHONPATH="{folder}" exec {sys.executable} "$@"\n')
    python.chmod(0o755)
    (folder / "id").symlink_to(shutil.which("id") or "id")
    return subprocess.run(
        ["/bin/sh", str(ROOT / "dev" / "system.sh"), str(python), part],
        env={"PATH": str(folder)},
        check=False,
        capture_output=True,
        text=True,
    )


def test_a_machine_that_has_everything_is_left_alone(tmp_path: Path) -> None:
    done = prepare("test", tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("part", ["setup", "test", "browser"])
def test_nothing_goes_on_without_a_module_that_makes_environments(
    tmp_path: Path, part: str
) -> None:
    done = prepare(part, tmp_path, "ensurepip")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == (
        f"{tmp_path}/python cannot make environments here; as root: apt-get install {VENV}\n"
    )


@pytest.mark.parametrize(("part", "code"), [("setup", 0), ("test", 1)])
def test_only_tests_need_opengl(tmp_path: Path, part: str, code: int) -> None:
    done = prepare(part, tmp_path, "ctypes")
    assert (done.returncode, done.stdout) == (code, "")
    assert done.stderr.endswith(f"as root: apt-get install {OPENGL_PACKAGES}\n" if code else "")
