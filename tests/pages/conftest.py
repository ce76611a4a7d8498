"""These tests need a browser and axe-core, those that drive a page an imitated headset as well.

`make test-pages` installs both.
"""

import os
from collections.abc import Iterator
from typing import Any

import pytest

AXE = "DUOBENCH_AXE"
"""Environment variable: the script of axe-core."""
IWER = "DUOBENCH_IWER"
"""Environment variable: the script of iwer, which imitates a headset."""

collect_ignore_glob = [] if AXE in os.environ else ["test_*.py"]
if IWER not in os.environ:
    collect_ignore_glob += ["test_driving.py", "test_headset*.py", "test_mouse*.py"]


@pytest.fixture(scope="module")
def window() -> Iterator[Any]:
    """A browser."""
    from tests.pages.windows import started

    with started() as window:
        yield window
