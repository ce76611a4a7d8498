import os
from pathlib import Path

import pytest

from dev.tools.pages import PHONE, VIEWS, View, measure, violations
from duobench.results.compare import compare, write_comparison
from tests.results.outcomes import play


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Comparison of two runs with each other and with the paper."""
    folder = tmp_path_factory.mktemp("runs")
    runs = [
        play(folder / name, {"sort": [stage] * 12, "carry_pot": [1] * 12}, name)
        for name, stage in (("new", 3), ("old", 1))
    ]
    return write_comparison(compare([*runs, "paper:ACT"]), folder / "both")


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.name)
def test_no_rule_of_accessibility_is_broken(page: Path, view: View) -> None:
    broken = violations(page, Path(os.environ["DUOBENCH_AXE"]), view)
    assert [(each["id"], each["nodes"]) for each in broken] == []


def test_phone_shows_no_more_than_its_width(page: Path) -> None:
    assert measure(page, PHONE, "document.documentElement.scrollWidth") == PHONE.width
