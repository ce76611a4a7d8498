"""Tests with LeRobot and the plugin, in an environment that `make test-lerobot` makes."""

from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

import pytest


class NotHere(pytest.Module):
    """A module of tests that cannot be imported."""

    def collect(self) -> NoReturn:
        pytest.skip("LeRobot is not installed here: make test-lerobot", allow_module_level=True)


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> NotHere | None:
    return None if find_spec("lerobot") else NotHere.from_parent(parent, path=module_path)
