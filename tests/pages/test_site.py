"""Pages of the site that `make site` built: rules of accessibility, and no wider than a phone."""

import os
from pathlib import Path

import pytest

from dev.tools.pages import DESKTOP, PHONE, VIEWS, View, measure, violations

SITE = "DUOBENCH_SITE"
"""Environment variable: the folder of the site."""
PAGES = (
    "index",
    "tasks/index",
    "tasks/pour_marbles",
    "tasks/gallery",
    "guides/index",
    "guides/real_arms",
    "reference/python",
    "reference/command_line",
    "reference/messages",
    "start/policies",
    "search",
)

CUT = """Math.max(...[...document.querySelectorAll(".table-wrapper")].map(
  (each) => each.scrollWidth - each.clientWidth))"""
"""Pixels by which the widest table is wider than its place."""

pytestmark = pytest.mark.skipif(SITE not in os.environ, reason="the site is not built")


def built(name: str) -> Path:
    return Path(os.environ[SITE]) / f"{name}.html"


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.name)
@pytest.mark.parametrize("name", PAGES)
def test_no_rule_of_accessibility_is_broken(name: str, view: View) -> None:
    axe = Path(os.environ["DUOBENCH_AXE"])
    found = violations(built(name), axe, view)
    assert [(each["id"], [node["html"] for node in each["nodes"]]) for each in found] == []


@pytest.mark.parametrize("name", PAGES)
def test_phone_shows_no_more_than_its_width(name: str) -> None:
    assert measure(built(name), PHONE, "document.documentElement.scrollWidth") == PHONE.width


@pytest.mark.parametrize("name", ["reference/options", "reference/schemas"])
def test_desktop_shows_tables_of_fields_whole(name: str) -> None:
    assert measure(built(name), DESKTOP, CUT) == 0
