"""What a person sees who leads: the robot's views, marks at the tools, and what is not so."""

from __future__ import annotations

import base64
import io
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Page

from dev.tools.pages import DESKTOP, PHONE
from duobench.core.types import SIDES, DuoCommand, Side
from duobench.tasks import get
from duobench.teleop.messages import Message
from duobench.teleop.plumb import PlumbLines
from duobench.teleop.teleop_page import LEADING_VIEW
from duobench.web.geometry import Geometry
from duobench.web.messages import pack_frame
from duobench.web.page import assets
from duobench.web.server import PageServer
from duobench.world.looks.look import CameraOffset, Look
from duobench.world.robot.cameras import POLICY_CAMERAS, View
from duobench.world.robot.frames import robot_with
from duobench.world.robot.gripper import DEFAULT_GRIPPER, GRIPPERS
from duobench.world.sim import placement
from duobench.world.sim.rendering import Renderer
from duobench.world.sim.simulation import Simulation
from tests.pages.windows import broken_rules, difference, opened, picture, until

TASK = "bin_sort"
OFFSET = CameraOffset(position=(0.1, 0.0, 0.0), rotation=(0.0, 0.0, 0.2), field_of_view=0.1)
LOOK = Look(cameras={"head": OFFSET})
COARSE = (18, 32)
"""Rows and columns of blocks in which pictures are compared."""
ALIKE = 8.0
"""Mean difference, 0 to 255, of two that show the same."""
WATCHED = {"title": TASK, "stages": ["lifted"], "max_stage": 1, "stage": 0, "state": "recording"}
LED = WATCHED | {"clutch": {"left": False, "right": True}}


class Shown:
    """A server with both arms over the table, one of them low."""

    def __init__(self, gripper: str = DEFAULT_GRIPPER) -> None:
        task = get(TASK)
        self.sim = Simulation(task.props, task.overview, robot_with(gripper))
        placement.first_valid(self.sim, task.layouts(3), task.id)
        self.turn(0.4)
        self.geometry = Geometry(self.sim.model, LOOK, LEADING_VIEW, cameras=True)
        self.server = PageServer(assets())
        self.server.listen(Message, lambda _message: None)
        self.server.publish_scene(self.geometry.name, self.geometry.data)

    def turn(self, angle: float) -> None:
        """Turn the shoulder of the right arm."""
        command = self.sim.duo.command()
        joints = command.joints.copy()
        joints[Side.RIGHT.index, 1] += angle
        self.sim.duo.set_configuration(DuoCommand(joints=joints, openings=command.openings))
        self.sim.forward()
        self.sim.contacts.update()
        self.rows = PlumbLines(self.sim).rows()

    def show(self, **status: Any) -> None:
        """Show a status, and where everything is."""
        self.server.publish_status(LED | status)
        poses = self.geometry.poses(self.sim.data)
        self.server.publish_frame(pack_frame(poses, 0, 0.0, tools=self.rows))


@pytest.fixture(scope="module")
def shown() -> Iterator[Shown]:
    shown = Shown()
    yield shown
    shown.server.close()


@pytest.fixture
def page(window: Browser, shown: Shown) -> Iterator[Page]:
    """A page that drives."""
    shown.show()
    with opened(window, shown.server.url) as page:
        page.click("#drive")
        page.get_by_role("toolbar", name="Views").wait_for()
        until(page, "document.querySelectorAll('#cameras figure').length == 3")
        yield page


def inset(page: Page, camera: str) -> NDArray[np.float64]:
    """What a small picture shows, coarsely."""
    data = page.evaluate(f"document.querySelector('[data-camera={camera}] canvas').toDataURL()")
    with Image.open(io.BytesIO(base64.b64decode(data.partition(",")[2]))) as image:
        return coarse(np.asarray(image.convert("RGB")))


def coarse(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Means of blocks."""
    rows, columns = COARSE
    small = Image.fromarray(image).resize((columns * 8, rows * 8), Image.Resampling.BOX)
    blocks = np.asarray(small).astype(np.float64).reshape(rows, 8, columns, 8, 3)
    return blocks.mean(axis=(1, 3))


@pytest.mark.parametrize("gripper", GRIPPERS)
def test_insets_show_what_the_cameras_of_the_robot_see(window: Browser, gripper: str) -> None:
    shown = Shown(gripper)
    shown.server.close()
    model, data = shown.sim.model, shown.sim.data
    with Renderer(model, height=180, width=320, look=LOOK) as renderer:
        seen = renderer.render_all(data, POLICY_CAMERAS)
    with Renderer(model, height=180, width=320) as renderer:
        nominal = coarse(renderer.render(data, "head"))
    with closing(PageServer(assets())) as server, opened(window, server.url) as page:
        server.publish_scene(shown.geometry.name, shown.geometry.data)
        server.publish_status(WATCHED)  # nobody leads: the light is where it is in images
        server.publish_frame(pack_frame(shown.geometry.poses(data), 0, 0.0))
        until(page, "document.querySelectorAll('#cameras canvas[width]').length == 3")
        page.wait_for_timeout(1000)
        for camera in POLICY_CAMERAS:
            apart = np.abs(inset(page, camera) - coarse(seen[camera])).mean()
            assert apart < ALIKE, camera
        assert np.abs(inset(page, "head") - nominal).mean() > 1.5 * ALIKE  # a look moved it


def test_a_ring_is_where_the_tool_is_and_says_its_height(page: Page, shown: Shown) -> None:
    camera = shown.geometry.header["camera"]
    view = View(eye=tuple(camera["eye"]), target=tuple(camera["target"]), fovy_deg=camera["fovy"])
    box = page.locator("canvas").first.bounding_box()
    assert box
    for side, row in zip(SIDES, shown.rows.astype(np.float64), strict=True):
        mark = page.locator(f".marks-of-tools [data-side={side}]")
        assert mark.locator(".name").text_content() == str(side).capitalize()
        assert mark.locator(".height").text_content() == f"{round(1000 * row[6])} mm"
        x, y, z = view.pose.inverse().apply(row[:3])
        wider = max(1.0, (4 / 3) * box["height"] / box["width"])
        scale = box["height"] / 2 / (np.tan(np.radians(camera["fovy"]) / 2) * wider)
        expected = box["width"] / 2 - scale * x / z, box["height"] / 2 + scale * y / z
        moved = str(mark.locator(".label").get_attribute("transform"))
        at = [float(each) for each in moved.removeprefix("translate(").rstrip(")").split()]
        np.testing.assert_allclose(at, expected, atol=1.0)
    right = page.locator(".marks-of-tools [data-side=right]")
    assert right.get_attribute("data-state") == "active"
    assert page.locator("[data-camera=left_wrist]").get_attribute("data-state") == "other"
    assert page.locator("[data-camera=right_wrist]").get_attribute("data-state") == "live"


def test_keys_and_buttons_change_the_view(page: Page) -> None:
    seen = [picture(page)]
    page.keyboard.press("6")
    for key in "7890":
        seen.append(picture(page))
        assert difference(seen[-2], seen[-1]) > 2
        page.keyboard.press(key)
    page.get_by_role("button", name="Front").click()
    page.wait_for_timeout(300)
    assert difference(seen[1], picture(page)) < 1
    page.keyboard.press("5")
    page.wait_for_timeout(300)
    assert difference(seen[0], picture(page)) < 1
    page.keyboard.press("f")
    until(page, "document.fullscreenElement != null")


def test_the_view_behind_a_hand_goes_with_it(page: Page, shown: Shown) -> None:
    def place(side: Side) -> list[float]:
        label = page.locator(f".marks-of-tools [data-side={side}] .label")
        moved = str(label.get_attribute("transform"))
        return [float(each) for each in moved.removeprefix("translate(").rstrip(")").split()]

    page.keyboard.press("0")
    picture(page)
    before = place(Side.RIGHT)
    shown.turn(-0.3)
    shown.show()
    picture(page)
    np.testing.assert_allclose(place(Side.RIGHT), before, atol=1.0)
    page.keyboard.press("1")
    picture(page)
    np.testing.assert_allclose(place(Side.LEFT), before, atol=60.0)
    shown.turn(0.3)
    shown.show()


def test_marks_get_thin_far_away(page: Page) -> None:
    def cross() -> str | None:
        return page.locator("[data-side=right] .cross").get_attribute("d")

    assert cross()
    page.locator("canvas").first.focus()
    for _ in range(12):
        page.keyboard.press("-")
    picture(page)
    assert not cross()  # a small cube would be below it
    width = page.locator("[data-side=right] .tool").evaluate(
        "(e) => getComputedStyle(e).strokeWidth"
    )
    assert float(width.removesuffix("px")) < 2.5


def test_an_arm_that_can_follow_no_farther_says_so(page: Page, shown: Shown) -> None:
    for _ in range(2):  # it takes a while, as an arm that lags for a moment is none
        page.wait_for_timeout(400)
        shown.show(limited={"left": False, "right": True}, step=page.evaluate("performance.now()"))
    page.get_by_text("The right arm can follow no farther that way.").wait_for()
    assert broken_rules(page) == []
    shown.show(limited={"left": False, "right": False})
    until(page, "[...document.querySelectorAll('.notices p')].every((line) => line.hidden)")


def test_who_was_taken_over_reads_by_whom(window: Browser, page: Page, shown: Shown) -> None:
    with opened(window, shown.server.url, PHONE) as other:
        other.get_by_role("button", name="Take over").click()
        page.get_by_text("Another page took over.").wait_for()
        assert other.evaluate("document.documentElement.scrollWidth") == PHONE.width
        assert broken_rules(other) == []
    until(page, "[...document.querySelectorAll('.notices p')].every((line) => line.hidden)")


SERVER = """
import sys
from duobench.web.page import assets
from duobench.web.server import PageServer
server = PageServer(assets())
server.publish_status({"title": "stopped"})
print(server.url, flush=True)
sys.stdin.read()
"""


def test_a_stopped_server_is_said(window: Browser) -> None:
    command = [sys.executable, "-c", SERVER]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as server:
        assert server.stdout
        with opened(window, server.stdout.readline().strip(), DESKTOP) as page:
            until(page, "document.querySelector('.ping').textContent.match(/^[0-9]/)")
            page.evaluate(
                """() => new MutationObserver((_, observer) => {
                  const line = document.querySelector(".notices .bad");
                  if (line.hidden) return;
                  window.said = line.textContent;
                  observer.disconnect();
                }).observe(document.querySelector(".notices"), {subtree: true, attributes: true})"""
            )
            os.kill(server.pid, signal.SIGSTOP)
            until(page, "window.said")
            words, _, seconds = page.evaluate("window.said").rpartition(" for ")
            assert words == "No answer from the server"
            assert 0.5 <= float(seconds.removesuffix(" s")) <= 1.5
            assert page.locator(".ping").text_content() == "– ms to the server"
            os.kill(server.pid, signal.SIGCONT)
            until(page, "document.querySelector('.notices .bad').hidden")
            until(page, "document.querySelector('.ping').textContent.match(/^[0-9]/)")
        server.communicate("")
