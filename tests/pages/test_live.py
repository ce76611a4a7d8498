"""The page of a server, with a scene, as somebody drives it."""

import gzip
import json
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page

import duobench
from duobench.envs.duo_env import base_of
from duobench.rig_sessions.teleoperation import AWAY
from duobench.web.geometry import Geometry
from duobench.web.messages import pack_frame
from duobench.web.page import assets
from duobench.web.server import PageServer
from tests.pages.driving import broken_rules, complaints_of, opened

MOST_BYTES = 150_000
"""Of the first load, compressed."""
STATUS: dict[str, Any] = {
    **{"task": "transfer_cube", "instruction": "Hand it over.", "state": "waiting"},
    **{"stage": 0, "max_stage": 1, "stages": ["it is lifted"]},
    "clutch": {"left": False, "right": False},
}


@pytest.fixture(scope="module")
def geometry() -> Iterator[tuple[Geometry, bytes]]:
    """A task as it begins: its scene, and a frame."""
    with closing(duobench.make("transfer_cube")) as env:
        env.reset(seed=0)
        simulation = base_of(env).simulation
        scene = Geometry(simulation.model)
        yield scene, pack_frame(scene.poses(simulation.data), 0, 0.0)


@pytest.fixture
def server(geometry: tuple[Geometry, bytes]) -> Iterator[PageServer]:
    scene, frame = geometry
    with closing(PageServer(assets())) as server:
        server.publish_scene(scene.name, scene.data)
        server.publish_frame(frame)
        server.publish_status(STATUS)
        yield server


def wait(page: Page, ready: Any) -> None:
    for _ in range(500):
        if ready():
            return
        page.wait_for_timeout(20)
    raise AssertionError("waited in vain")


def test_somebody_drives_the_page_of_a_server(server: PageServer) -> None:
    hands: list[dict[str, Any]] = []

    def take(is_driver: bool, data: bytes) -> None:
        message = json.loads(data)
        assert is_driver
        if message["kind"] == "hands":
            hands.append(message)

    server.on_message = take
    with opened() as page:
        complaints = complaints_of(page)
        page.goto(server.url)
        page.get_by_role("button", name="Drive").click()
        page.get_by_role("button", name="Left arm").click()
        wait(page, lambda: len(hands) > 3)
        box = page.locator("canvas").bounding_box()
        assert box
        middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(*middle)
        page.mouse.down()
        page.mouse.move(middle[0], middle[1] - 40, steps=4)
        page.mouse.up()
        wait(page, lambda: hands[-1]["seq"] > 3 and not hands[-1]["left"]["squeeze"])
        page.get_by_text("Controls", exact=True).click()
        assert broken_rules(page) == []
        assert complaints == []
    poses = np.array([each["left"]["pose"] for each in hands if each["left"]["squeeze"]])
    shift = poses[-1, :3] - poses[0, :3]
    assert shift[2] > 0.05
    assert np.allclose(poses[:, 3:], [1, 0, 0, 0])
    assert not any(each["right"]["squeeze"] for each in hands)


def test_the_first_load_is_small(geometry: tuple[Geometry, bytes]) -> None:
    code = sum(len(gzip.compress(body)) for _, body in assets().values())
    assert code + len(geometry[0].data) < MOST_BYTES


def test_a_recording_that_waits_says_so_and_may_be_discarded(server: PageServer) -> None:
    said: list[str] = []
    server.on_message = lambda _is_driver, data: said.append(json.loads(data)["kind"])
    with opened() as page:
        page.goto(server.url)
        page.get_by_role("button", name="Drive").click()
        server.publish_status(STATUS | {"state": "paused", "note": AWAY})
        page.get_by_text("Paused", exact=True).wait_for()
        page.get_by_text(AWAY).wait_for()
        assert broken_rules(page) == []
        page.get_by_role("button", name="Discard").click()
        wait(page, lambda: "discard" in said)
