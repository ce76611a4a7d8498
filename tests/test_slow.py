"""The lists of slow and long tests name tests, and each of them once."""

import re
from pathlib import Path

from tests.conftest import LONG, SLOW


def test_every_slow_test_is_one() -> None:
    files = Path(__file__).parent.rglob("test_*.py")
    names = {
        name
        for file in files
        for name in re.findall(r"def (test_\w+)\(", file.read_text(encoding="utf-8"))
    }
    assert (SLOW | LONG) - names == set()
    assert not SLOW & LONG
