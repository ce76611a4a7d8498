"""The examples of the Python API on the site do what stands below them."""

from __future__ import annotations

import doctest
import importlib
import re
from pathlib import Path

import pytest

from tests.docs.markdown import DOCS, text_of

PAGE = DOCS / "site_examples.txt"
AT_LEAST = 25
EXAMPLES = dict(re.findall(r"^## (\S+)\n(.*?)(?=^## |\Z)", text_of(PAGE), re.DOTALL | re.MULTILINE))


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs_as_shown(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    example = doctest.DocTestParser().get_doctest(EXAMPLES[name], {}, name, str(PAGE), 0)
    assert example.examples
    said: list[str] = []
    doctest.DocTestRunner().run(example, out=said.append)
    assert "".join(said) == ""


def test_there_are_enough_and_each_is_of_a_public_name() -> None:
    assert len(EXAMPLES) >= AT_LEAST
    for name, code in EXAMPLES.items():
        package, _, own = name.rpartition(".")
        assert own in importlib.import_module(package).__all__
        assert own in code
