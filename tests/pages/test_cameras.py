"""The page of teleoperation on a rig, with the images of its cameras, in a browser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from dev.tools.pages import DESKTOP, PHONE, View
from duobench.core.types import POLICY_CAMERAS
from duobench.real.sessions.cameras import CameraFeed
from duobench.real.sessions.rig_teleoperation import RigTeleopPage
from duobench.web.page import assets
from duobench.web.server import PageServer
from tests.pages.windows import DARK_PHONE, broken_rules, opened, until
from tests.real.rigs import camera, wait
from tests.teleop.test_real import Bench


class Led:
    """A session on a simulated rig, whose page a browser has open."""

    def __init__(self, folder: Path, ending: ExitStack) -> None:
        self.bench = Bench(folder)
        ending.callback(self.bench.session.close)
        self.server = PageServer(assets())
        ending.callback(self.server.close)
        self.feed = CameraFeed(self.bench.duo, self.server)
        ending.callback(self.feed.close)
        self.live = RigTeleopPage(self.bench.session, self.server)


@pytest.fixture
def led(tmp_path: Path) -> Iterator[Led]:
    with ExitStack() as ending:
        yield Led(tmp_path, ending)


def numbers(page: Page) -> list[int]:
    """The images that are shown."""
    return page.eval_on_selector_all(
        "#cameras figure", "tiles => tiles.map((tile) => Number(tile.dataset.shown))"
    )


def ready(page: Page, led: Led) -> None:
    page.wait_for_selector("#cameras img", timeout=60_000)
    until(page, "document.querySelectorAll('#cameras img').length == 3")
    led.live.show()
    until(page, "document.querySelector('h1').textContent != 'DuoBench'")


@pytest.mark.parametrize("view", [DESKTOP, PHONE, DARK_PHONE], ids=lambda view: view.name)
def test_no_rule_of_accessibility_is_broken(window: Browser, led: Led, view: View) -> None:
    with opened(window, led.server.url, view) as page:
        ready(page, led)
        assert page.evaluate("document.documentElement.scrollWidth") == view.width
        assert broken_rules(page) == []
        camera(led.bench.duo, "head").is_silent = True
        wait(led.bench.duo, 1.0)
        until(page, "document.querySelector('#cameras figure').dataset.state == 'stale'")
        assert page.evaluate("document.documentElement.scrollWidth") == view.width
        assert broken_rules(page) == []


def test_images_have_names_and_the_newest_is_shown(window: Browser, led: Led) -> None:
    with opened(window, led.server.url) as page:
        ready(page, led)
        for name in POLICY_CAMERAS:
            title = f"Live image of the {name.replace('_', ' ')} camera"
            assert page.get_by_role("img", name=title, exact=True).count() == 1
        before = numbers(page)
        wait(led.bench.duo, 2.0)
        until(page, f"document.querySelector('#cameras figure').dataset.shown >= {before[0] + 59}")
        assert page.locator("#cameras [role=status]").all_text_contents() == [""] * 3


def test_a_camera_that_hangs_says_so_and_loads_nothing(window: Browser, led: Led) -> None:
    with opened(window, led.server.url) as page:
        ready(page, led)
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        camera(led.bench.duo, "head").is_silent = True
        wait(led.bench.duo, 1.0)
        tile = page.locator("#cameras figure").first
        until(page, "document.querySelector('#cameras figure').dataset.state == 'stale'")
        said = tile.inner_text()
        assert "No new image." in said
        assert "s old" in said
        page.wait_for_timeout(500)
        assert not any("camera-head" in url for url in asked)
        assert any("camera-left_wrist" in url for url in asked)
        camera(led.bench.duo, "head").is_silent = False
        wait(led.bench.duo, 0.1)
        until(page, "document.querySelector('#cameras figure').dataset.state == 'live'")


def test_a_server_that_is_silent_is_told(window: Browser, led: Led) -> None:
    with opened(window, led.server.url) as page:
        ready(page, led)
        led.feed.close()
        until(page, "document.querySelector('#cameras figure').dataset.state == 'stale'")
        said = page.locator("#cameras figure").first.inner_text()
        assert "says nothing about this camera" in said
