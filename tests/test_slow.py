"""The list of slow tests names tests."""

import re
from pathlib import Path

from tests.conftest import SLOW


def test_every_slow_test_is_one() -> None:
    files = Path(__file__).parent.rglob("test_*.py")
    names = {
        name
        for file in files
        for name in re.findall(r"def (test_\w+)\(", file.read_text(encoding="utf-8"))
    }
    assert SLOW - names == set()
