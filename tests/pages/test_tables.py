"""Pages that compare: two runs with each other and with the paper."""

import os
from pathlib import Path

import pytest

from dev.tools.pages import PHONE, VIEWS, View, measure, violations
from duobench.results.comparison import compare, write_comparison
from tests.results.outcomes import play


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A comparison of two runs and the paper's."""
    folder = tmp_path_factory.mktemp("runs")
    runs = [
        play(folder / name, {"sort": [stage] * 12, "carry_pot": [1] * 12}, name)
        for name, stage in (("new", 3), ("old", 1))
    ]
    return [write_comparison(compare([*runs, "paper:ACT"]), folder / "both")]


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.name)
def test_no_rule_of_accessibility_is_broken(pages: list[Path], view: View) -> None:
    axe = Path(os.environ["DUOBENCH_AXE"])
    for page in pages:
        assert [(each["id"], each["nodes"]) for each in violations(page, axe, view)] == []


def test_phone_shows_no_more_than_its_width(pages: list[Path]) -> None:
    for page in pages:
        assert measure(page, PHONE, "document.documentElement.scrollWidth") == PHONE.width


def test_a_long_word_makes_no_page_wider(pages: list[Path]) -> None:
    widened = "document.querySelector('h2').textContent = 'w'.repeat(300)"
    for page in pages:
        width = measure(page, PHONE, f"({widened}, document.documentElement.scrollWidth)")
        assert width == PHONE.width
