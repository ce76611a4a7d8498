"""Packages of the field install a top-level package `tests`; ours must be found before it."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
CHILD = """
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from tests.envs.tools import waves


def test_helpers_are_ours_in_spawned_processes_too():
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        assert (pool.submit(waves, 2).result() == waves(2)).all()
"""


def test_tests_run_beside_another_package_of_that_name(tmp_path: Path) -> None:
    foreign = tmp_path / "installed" / "tests"
    foreign.mkdir(parents=True)
    (foreign / "__init__.py").write_text("raise ImportError('another package')\n")
    probe = tmp_path / "test_probe.py"
    probe.write_text(CHILD)
    path = os.pathsep.join([str(foreign.parent), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    result = subprocess.run(
        [*command, "-c", str(ROOT / "pyproject.toml"), "--rootdir", str(ROOT), str(probe)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": path.rstrip(os.pathsep)},
        check=False,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "1 passed" in result.stdout
