"""The pages on environments, reinforcement learning and other hardware: their code runs."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.docs.markdown import blocks, modules, page_of, run
from tests.quick_first import quick_first

NAMES = ("environments", "reinforcement_learning", "other_hardware")
PAGES = tuple(map(page_of, NAMES))
ELSEWHERE = ("RecordVideo", "stable_baselines3")
"""What needs libraries that `make test-ecosystem` has, which runs such blocks."""
CODE = [
    code
    for page in PAGES
    for code in blocks(page, "python")
    if not any(word in code for word in ELSEWHERE)
]


@pytest.mark.parametrize("code", quick_first(CODE, quick=2))
def test_code_runs(code: str, tmp_path: Path) -> None:
    # In a file: new processes import it.
    (tmp_path / "shown.py").write_text(code, encoding="utf-8")
    assert run([sys.executable, "shown.py"], tmp_path)


def test_programs_have_names() -> None:
    assert "vector.py" in modules(PAGES[0])
