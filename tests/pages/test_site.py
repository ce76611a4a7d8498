"""Pages of the site that `make site` built: rules of accessibility, and no wider than a phone."""

import os
from pathlib import Path

import pytest

from dev.tools.pages import PHONE, VIEWS, View, measure, violations

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
    "reference/options",
    "reference/schemas",
    "start/policies",
    "search",
)

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
