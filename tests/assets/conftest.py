"""Fixtures of the mesh store's tests: one real download, shared by all of them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from duobench.assets import derived
from duobench.assets.derived import MeshSet

# A port on which nothing ever listens: connections are refused at once.
NOWHERE = "http://127.0.0.1:9"


@pytest.fixture(scope="session")
def filled_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache that a process of its own has filled from the package index."""
    root = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        root = root.parent  # all workers share one cache, and its lock
    cache = root / "filled-cache"
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in {"DUOBENCH_ASSETS", "MENAGERIE_ROOT"}
    } | {
        "DUOBENCH_CACHE": str(cache),
        "MENAGERIE_CACHE_DIR": str(root / "empty-menagerie"),
        "MENAGERIE_BASE_URL": NOWHERE,
    }
    command = [sys.executable, "-c", "from duobench.assets import meshes; meshes.prepare()"]
    subprocess.run(command, env=environment, check=True)
    return cache


@pytest.fixture(scope="session")
def mesh_set(filled_cache: Path) -> MeshSet:
    """All derived meshes of the filled cache."""
    meshes = derived.load(derived.path_in(filled_cache))
    assert meshes is not None
    return meshes


@pytest.fixture
def sealed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, and no server in reach; returns the cache folder."""
    for name in list(os.environ):
        if name.startswith(("PIP_", "MENAGERIE_", "DUOBENCH_")):
            monkeypatch.delenv(name)
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_INDEX_URL", f"{NOWHERE}/simple")
    monkeypatch.setenv("PIP_RETRIES", "0")
    monkeypatch.setenv("MENAGERIE_BASE_URL", NOWHERE)
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "menagerie"))
    monkeypatch.setenv("DUOBENCH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"
