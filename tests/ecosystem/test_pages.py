"""The pages on environments and on reinforcement_learning: what needs other libraries runs here."""

import sys
from pathlib import Path

import pytest

from tests.docs.markdown import blocks, run
from tests.docs.test_environments import ELSEWHERE, PAGES

CODE = [
    code
    for page in PAGES
    for code in blocks(page, "python")
    if any(word in code for word in ELSEWHERE)
]


@pytest.mark.parametrize("code", CODE)
def test_code_of_the_pages_runs(code: str, tmp_path: Path) -> None:
    (tmp_path / "shown.py").write_text(code, encoding="utf-8")
    run([sys.executable, "shown.py"], tmp_path)
    assert len(list(tmp_path.iterdir())) > 1
