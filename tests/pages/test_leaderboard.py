import os
from pathlib import Path

import pytest

from dev.tools.pages import PHONE, VIEWS, View, measure, violations
from duobench.results.leaderboard import Board, RefusedBundle, begin_site, write_site
from duobench.results.suite import find_tasks
from tests.results.boards import entry


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The first page and a policy's, of ranked, privileged, partial and refused bundles."""
    out = tmp_path_factory.mktemp("site")
    few = entry("few", tasks=find_tasks(("bin_sort",)), episodes=3)
    entries = (entry("a_module.of_my.own:PolicyWithALongName"), entry("expert", 0.9), few)
    refused = RefusedBundle(file="x" * 80 + ".duobench.zip", reason="It is damaged.")
    begin_site(out)
    return [write_site(Board(entries=entries, refused=(refused,)), out), out / entries[0].page]


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.name)
def test_no_rule_of_accessibility_is_broken(pages: list[Path], view: View) -> None:
    axe = Path(os.environ["DUOBENCH_AXE"])
    for page in pages:
        assert [(each["id"], each["nodes"]) for each in violations(page, axe, view)] == []


def test_phone_shows_no_more_than_its_width(pages: list[Path]) -> None:
    for page in pages:
        assert measure(page, PHONE, "document.documentElement.scrollWidth") == PHONE.width
