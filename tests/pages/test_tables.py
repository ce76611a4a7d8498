"""Pages that compare: two runs with each other and with the paper, and a leaderboard."""

import os
from pathlib import Path

import pytest

from dev.tools.pages import PHONE, VIEWS, View, measure, violations
from duobench.results.compare import compare, write_comparison
from duobench.results.leaderboard import Board, RefusedBundle, begin_site, write_site
from duobench.results.suite import find_tasks
from tests.results.boards import entry
from tests.results.outcomes import play


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A comparison; and a leaderboard's first page and a policy's, of ranked, privileged, partial
    and refused bundles."""
    folder, out = tmp_path_factory.mktemp("runs"), tmp_path_factory.mktemp("site")
    runs = [
        play(folder / name, {"sort": [stage] * 12, "carry_pot": [1] * 12}, name)
        for name, stage in (("new", 3), ("old", 1))
    ]
    comparison = write_comparison(compare([*runs, "paper:ACT"]), folder / "both")
    few = entry("few", tasks=find_tasks(("bin_sort",)), episodes=3)
    entries = (entry("a_module.of_my.own:PolicyWithALongName"), entry("expert", 0.9), few)
    refused = RefusedBundle(file="x" * 80 + ".duobench.zip", reason="It is damaged.")
    begin_site(out)
    site = write_site(Board(entries=entries, refused=(refused,)), out)
    return [comparison, site, out / entries[0].page]


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
