"""Packages of the field install a top-level package `tests`; ours must be found before it."""

import os
from pathlib import Path

from tests.children import ran

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
    command = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", str(ROOT / "pyproject.toml")]
    env = {**os.environ, "PYTHONPATH": path.rstrip(os.pathsep)}
    result = ran(*command, "--rootdir", str(ROOT), str(probe), cwd=ROOT, env=env)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "1 passed" in result.stdout
