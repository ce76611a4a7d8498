"""What the cameras of a simulated rig see, on a page over a real socket."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from typing import Any

import numpy as np
import pytest
from PIL import Image

from duobench.core.types import POLICY_CAMERAS
from duobench.real.drivers.frames import STALE_S
from duobench.real.duo import FrankaDuo
from duobench.real.sessions.cameras import PERIOD_S, SHOWN_WIDTH, CameraFeed, jpeg
from duobench.web.page import assets
from duobench.web.server import PageServer
from tests.real.rigs import camera, new_rig, wait
from tests.web.pages import Page, get, open_page, wait_until


class Shown:
    """A rig, a server and a page that has it open."""

    def __init__(self, ending: ExitStack) -> None:
        self.duo: FrankaDuo = new_rig()
        ending.callback(self.duo.close)
        self.server = PageServer(assets())
        ending.callback(self.server.close)
        self.feed = CameraFeed(self.duo, self.server)
        ending.callback(self.feed.close)
        self.page: Page = ending.enter_context(open_page(self.server.url))

    def news(self, **wanted: Any) -> dict[str, dict[str, Any]]:
        """What the page hears of each camera, once it has heard something of the head's."""
        while True:
            cameras = self.page.hear_of("cameras")["cameras"]
            by_name = {each["name"]: each for each in cameras}
            if wanted.items() <= by_name["head"].items():
                return by_name

    def image(self, about: dict[str, Any]) -> np.ndarray:
        status, headers, content = get(self.server.url, f"{about['image']}&number=1")
        assert (status, headers["Content-Type"]) == (200, "image/jpeg")
        with Image.open(io.BytesIO(content)) as picture:
            return np.asarray(picture)


@pytest.fixture
def shown() -> Iterator[Shown]:
    with ExitStack() as ending:
        yield Shown(ending)


def test_the_newest_image_of_every_camera_is_shown(shown: Shown) -> None:
    assert shown.news(number=None)["head"]["image"] == ""  # not connected yet
    shown.duo.start()
    first = shown.news(number=0)
    assert tuple(first) == POLICY_CAMERAS
    assert [each["title"] for each in first.values()] == [
        "Head camera",
        "Left wrist camera",
        "Right wrist camera",
    ]
    wait(shown.duo, 1.0 + 1e-6)
    later = shown.news(number=30)
    assert not any(each["stale_s"] for each in later.values())
    seen = {name: shown.image(each) for name, each in later.items()}
    frames = shown.duo.frames()
    for name, image in seen.items():
        assert image.shape == (360, SHOWN_WIDTH, 3)
        expected = frames[name].image.reshape(360, 2, 640, 2, 3).mean((1, 3))
        assert np.abs(image - expected).mean() < 2.0


def test_a_camera_that_hangs_says_so_and_costs_nothing(
    shown: Shown, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown.duo.start()
    shown.news(number=0)
    published: list[str] = []
    publish = shown.server.publish_image

    def note(name: str, data: bytes) -> str:
        published.append(name)
        return publish(name, data)

    monkeypatch.setattr(shown.server, "publish_image", note)
    camera(shown.duo, "head").is_silent = True
    wait(shown.duo, STALE_S + 0.6)
    told = shown.news(stale_s=pytest.approx(STALE_S + 0.6, abs=0.05))
    assert told["head"]["number"] == 0
    assert told["left_wrist"]["stale_s"] is None
    assert told["left_wrist"]["number"] >= 26
    assert set(published) == {"camera-left_wrist", "camera-right_wrist"}
    camera(shown.duo, "head").is_silent = False
    wait(shown.duo, 0.1)
    assert shown.news(stale_s=None)["head"]["number"] > 26
    shown.feed.close()
    count = len(published)
    for _ in range(3):
        shown.feed.look()
    assert len(published) <= count + len(POLICY_CAMERAS), "an image was encoded twice"


def test_nothing_is_encoded_where_nobody_looks() -> None:
    duo = new_rig()
    with closing(duo), closing(PageServer(assets())) as server:
        duo.start()
        with closing(CameraFeed(duo, server)) as feed:
            with open_page(server.url) as page:
                page.hear_of("cameras")
            wait_until(lambda: not server.has_viewers)
            wait(duo, 1.0 + 1e-6)
            time.sleep(3 * PERIOD_S)
            assert {frame.index for frame, _ in feed._shown.values()} == {0}
            with open_page(server.url) as page:
                page.hear_of("cameras")
            assert {frame.index for frame, _ in feed._shown.values()} == {30}
        feed.close()


def test_small_images_stay_as_they_are() -> None:
    with Image.open(io.BytesIO(jpeg(np.zeros((48, 64, 3), np.uint8), SHOWN_WIDTH))) as picture:
        assert picture.size == (64, 48)
    with Image.open(io.BytesIO(jpeg(np.zeros((1080, 1920, 3), np.uint8), SHOWN_WIDTH))) as picture:
        assert picture.size == (SHOWN_WIDTH, 360)
