import base64
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from msgspec import to_builtins
from playwright.sync_api import Browser, Page

from dev.tools.pages import PHONE, View
from duobench.evaluation.replay.viewer import Command, SeekStep, SelectItem, SetPlaying
from duobench.tasks import get
from duobench.teleop.messages import (
    Alone,
    Discard,
    Hands,
    Instruction,
    Keep,
    Message,
    Operator,
    Restore,
)
from duobench.teleop.panel import LEAD, SOLVED, Button, Panel
from duobench.teleop.teleoperation import AWAY, TITLES
from duobench.web import access
from duobench.web.geometry import Geometry
from duobench.web.messages import PageMessage, pack_frame
from duobench.web.page import assets
from duobench.web.server import PageServer
from duobench.web.track import decode, encode
from duobench.world.sim import placement
from duobench.world.sim.simulation import Simulation
from tests.pages.windows import VIEWS, broken_rules, difference, opened, picture, until

FIRST_LOAD = 150_000
STATUS = {
    "title": "transfer_cube",
    "instruction": "Hand the cube over.",
    "next": "Grasp the cube.",
    "stages": ["grasped", "handed over", "placed"],
    "max_stage": 3,
    "stage": 1,
    "stage_changes": [[4, 1], [20, 2]],
    "step": 4,
    "steps": 30,
    "state": "paused",
    "selected": "a",
}
ITEMS = [
    {"id": "a", "title": "Episode 0", "detail": "success", "state": ""},
    {"id": "b", "title": "Episode 1", "detail": "stage 2 of 3", "state": ""},
]

DRIVEN = STATUS | {"steps": None, "clutch": {"left": False, "right": False}, "state": "waiting"}


HIGH_AT = """(milliseconds) => {
  document.querySelector(".ping").textContent = `${milliseconds} ms to the server`;
  return document.querySelector(".line-of-facts").clientHeight;
}"""
"""How high the line of facts is while the server takes some time to answer."""


class Shown:
    """A server with a scene, and what its pages asked for."""

    def __init__(self) -> None:
        task = get("transfer_cube")
        self.simulation = Simulation(task.props, task.overview)
        placement.first_valid(self.simulation, task.layouts(0), task.id)
        self.geometry = Geometry(self.simulation.model)
        self.server = PageServer(assets())
        self.asked: list[PageMessage] = []
        self.server.listen(Command | Message, self.asked.append)
        self.server.publish_scene(self.geometry.name, self.geometry.data)
        self.server.publish_items(ITEMS)
        self.server.publish_status(STATUS)
        self.frame(4)

    def frame(self, step: int) -> None:
        poses = self.geometry.poses(self.simulation.data)
        self.server.publish_frame(pack_frame(poses, step, step / 30))


@pytest.fixture(scope="module")
def shown() -> Iterator[Shown]:
    shown = Shown()
    yield shown
    shown.server.close()


@pytest.fixture
def page(window: Browser, shown: Shown) -> Iterator[Page]:
    shown.server.publish_status(STATUS)
    shown.asked.clear()
    with opened(window, shown.server.url) as page:
        ready(page)
        yield page


def ready(page: Page) -> None:
    """Wait until the page shows the scene: it is not the colour of an empty canvas."""
    until(page, "document.querySelector('h1').textContent == 'transfer_cube'")
    for _ in range(100):
        if len(np.unique(picture(page).reshape(-1, 3), axis=0)) > 1000:
            return
    raise AssertionError("the canvas stayed blank")


def wait(page: Page, ready: Callable[[], object], words: Callable[[], object] = str) -> None:
    for _ in range(500):
        if ready():
            return
        page.wait_for_timeout(20)
    raise AssertionError(words())


def wait_for(page: Page, shown: Shown, message: PageMessage) -> None:
    wait(page, lambda: message in shown.asked, lambda: f"the page asked for {shown.asked}")


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.name)
def test_no_rule_of_accessibility_is_broken(window: Browser, shown: Shown, view: View) -> None:
    with opened(window, shown.server.url, view) as page:
        ready(page)
        assert broken_rules(page) == []


def test_phone_shows_no_more_than_its_width(window: Browser, shown: Shown) -> None:
    with opened(window, shown.server.url, PHONE) as page:
        ready(page)
        assert page.evaluate("document.documentElement.scrollWidth") == PHONE.width


def test_first_load_is_small(page: Page) -> None:
    sizes = page.evaluate(
        """["navigation", "resource"].flatMap((kind) => performance.getEntriesByType(kind))
          .map((entry) => [entry.name, entry.encodedBodySize])"""
    )
    assert any(".bin" in name for name, _ in sizes)
    assert 30_000 < sum(size for _, size in sizes) <= FIRST_LOAD


def test_status_is_shown_in_words(page: Page, shown: Shown) -> None:
    assert page.locator(".instruction").text_content() == "Hand the cube over."
    assert page.locator(".next").text_content() == "Next: Grasp the cube."
    states = page.locator(".stage-chip").evaluate_all("(chips) => chips.map(c => c.dataset.state)")
    assert states == ["reached", "later", "open"]
    assert page.locator(".link").text_content() == "Connected"
    assert page.locator(".marks i").count() == 2
    shown.server.publish_status({"title": "transfer_cube", "state": "playing", "stage": 0})
    until(page, "document.querySelector('.state').textContent == 'Playing'")
    assert page.locator(".timeline").is_hidden()
    shown.server.publish_items([])
    until(page, "document.querySelector('#choice').hidden")
    shown.server.publish_items(ITEMS)


def test_people_choose_seek_and_play(page: Page, shown: Shown) -> None:
    page.click("[data-item=b]")
    wait_for(page, shown, SelectItem(id="b"))
    page.locator(".timeline input").fill("12")
    wait_for(page, shown, SeekStep(step=12))
    page.click(".play")
    wait_for(page, shown, SetPlaying(on=True))


def panel(*buttons: Button, title: str = TITLES["decide"], todo: str = "") -> dict[str, Any]:
    """The panel of a session."""
    made = Panel(steps=(LEAD, SOLVED), now=1, title=title, todo=todo, buttons=buttons)
    return made.to_json()


def test_driver_is_asked_what_becomes_of_an_episode(page: Page, shown: Shown) -> None:
    assert page.locator("#driving").is_hidden()  # nobody asked for hands
    page.route("**/inputs.js", lambda route: route.fulfill(body=_INPUTS, content_type=_MODULE))
    status = {**STATUS, "steps": None, "clutch": {"left": False, "right": True}, "kept": 2}
    discard = Button(id="discard", words="Discard", message=Discard())
    shown.server.publish_status(
        {**status, "state": "recording", "wanted": 10, "panel": panel(discard)}
    )
    page.click("#drive")
    until(page, "document.querySelector('.role').textContent == 'You drive'")
    assert [page.locator(f"#{id}").is_visible() for id in ("drive", "keep", "discard")] == [
        False,
        False,
        True,
    ]
    assert page.locator(".facts").text_content() == "Kept2 of 10Clutchright closed"
    # On real arms nothing else sees that it is solved.
    solved = Button(id="keep", words="Solved", message=Keep())
    shown.server.publish_status({**status, "state": "recording", "panel": panel(solved, discard)})
    page.wait_for_selector("#keep:visible")
    assert page.locator("#keep").text_content() == "Solved"
    why_not = replace(discard, why_not="the arms move")
    keep = replace(solved, words="Keep", is_next=True)
    shown.server.publish_status({**status, "state": "success", "panel": panel(why_not, keep)})
    page.wait_for_selector("#keep.next")
    assert page.locator("#discard").is_disabled()
    assert page.locator(".buttons").text_content() == "Discard: the arms moveKeep"
    assert page.locator(".steps [aria-current=step]").text_content() == "2 Solved?"
    assert broken_rules(page) == []
    page.get_by_role("button", name="Keep").click()
    wait_for(page, shown, Keep())
    page.fill("#wording input", "Pass it on.")
    page.keyboard.press("Enter")
    wait_for(page, shown, Instruction("Pass it on."))


def test_the_operator_is_chosen_on_the_page_and_takes_the_name_along(
    page: Page, window: Browser, shown: Shown
) -> None:
    people = {"operator": "P07", "operators": ["P07", "P09"], "wording": "Pass it on."}
    shown.server.publish_status(DRIVEN | people)
    page.get_by_role("button", name="Drive").click()
    until(page, "document.querySelector('.role').textContent == 'You drive as P07'")
    assert page.locator("#wording input").input_value() == "Pass it on."
    names = page.locator("#operators option").evaluate_all("(all) => all.map((one) => one.value)")
    assert names == ["P07", "P09"]
    with opened(window, shown.server.url) as other:
        box = other.get_by_label("Pseudonym of the operator")
        assert box.input_value() == "P07"
        box.fill("P08")
        other.keyboard.press("Enter")
        assert broken_rules(other) == []
        assert not any(isinstance(each, Operator) for each in shown.asked), "it only watches"
        other.get_by_role("button", name="Take over").click()
        wait_for(other, shown, Operator("P08"))
        shown.server.publish_status(DRIVEN | people | {"operator": "P08"})
        until(page, "document.querySelector('.role').textContent.startsWith('P08 drives')")
        page.get_by_role("button", name="Take over").click()
        wait_for(page, shown, Operator("P07"))


_MODULE = "text/javascript"
_INPUTS = """export const startInputs = () => ({
  headset: { isWorn: false },
  hands: { sides: [], latency: { ms: null, arrived() {}, drawn() {} } } });"""


def test_somebody_drives_the_page_of_a_server(page: Page, shown: Shown) -> None:
    shown.server.publish_status(DRIVEN)

    def hands() -> list[dict[str, Any]]:
        return [to_builtins(each) for each in shown.asked if isinstance(each, Hands)]

    page.get_by_role("button", name="Drive").click()
    page.get_by_role("button", name="Left arm").click()
    wait(page, lambda: len(hands()) > 3)
    box = page.locator("canvas").first.bounding_box()
    assert box
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0], middle[1] - 40, steps=4)
    page.mouse.up()
    wait(page, lambda: hands()[-1]["seq"] > 3 and not hands()[-1]["left"]["squeeze"])
    page.get_by_text("Controls", exact=True).click()
    assert broken_rules(page) == []
    poses = np.array([each["left"]["pose"] for each in hands() if each["left"]["squeeze"]])
    assert poses[-1, 2] - poses[0, 2] > 0.05
    assert np.allclose(poses[:, 3:], [1, 0, 0, 0])
    assert not any(each["right"]["squeeze"] for each in hands())


def test_a_recording_that_waits_says_so_and_may_be_discarded(page: Page, shown: Shown) -> None:
    shown.server.publish_status(DRIVEN)
    page.get_by_role("button", name="Drive").click()
    discard = Button(id="discard", words="Discard", message=Discard())
    away = panel(discard, title=TITLES["paused"], todo=AWAY)
    shown.server.publish_status(DRIVEN | {"state": "paused", "panel": away})
    page.get_by_text("Paused", exact=True).wait_for()
    page.get_by_text(AWAY).wait_for()
    assert broken_rules(page) == []
    page.get_by_role("button", name="Discard").click()
    wait_for(page, shown, Discard())


def test_page_says_that_the_world_stands_and_lets_it_run_alone(page: Page, shown: Shown) -> None:
    led = DRIVEN | {"state": "recording", "pace": "led", "led_s": 34.6, "limit_s": 600.0}
    shown.server.publish_status(led)
    page.get_by_role("button", name="Drive").click()
    page.get_by_text("34 of 600 s led", exact=True).wait_for()
    assert "Worldruns as you lead" in str(page.locator(".facts").text_content())
    shown.server.publish_status(led | {"pace": "standing"})
    page.get_by_text("Standing still: lead on", exact=True).wait_for()
    button = page.get_by_role("button", name="Run alone")
    assert button.get_attribute("aria-pressed") == "false"
    assert broken_rules(page) == []
    button.click()
    wait_for(page, shown, Alone())
    shown.server.publish_status(led | {"pace": "alone", "alone": True})
    page.wait_for_selector("#alone[aria-pressed=true]")
    assert broken_rules(page) == []


def test_line_of_facts_is_as_high_while_numbers_grow(page: Page, shown: Shown) -> None:
    page.set_viewport_size({"width": 1240, "height": 780})
    discard = Button(id="discard", words="Discard", message=Discard())
    led = DRIVEN | {"state": "recording", "operator": "follower", "limit_s": 1800.0}
    led |= {"panel": panel(discard, title="Recording")}
    shown.server.publish_status(led | {"led_s": 1.0})
    page.get_by_role("button", name="Drive").click()
    page.get_by_text("You drive as follower", exact=True).wait_for()
    heights = set()
    for seconds in (1, 9, 10, 99, 100, 1799):
        shown.server.publish_status(led | {"led_s": float(seconds)})
        page.get_by_text(f"{seconds} of 1800 s led", exact=True).wait_for()
        heights |= {page.evaluate(HIGH_AT, milliseconds) for milliseconds in (0, 12, 345, 6789)}
    assert len(heights) == 1, heights


def test_what_was_discarded_is_restored_by_a_button(page: Page, shown: Shown) -> None:
    shown.server.publish_status(DRIVEN)
    page.get_by_role("button", name="Drive").click()
    button = page.get_by_role("button", name="Restore the last discarded")
    until(page, "document.querySelector('.role').textContent == 'You drive'")
    assert button.is_hidden()
    restore = Button(id="restore", words="Restore the last discarded", message=Restore())
    shown.server.publish_status(DRIVEN | {"discarded": 2, "panel": panel(restore)})
    button.click()
    wait_for(page, shown, Restore())
    assert "Discarded2" in str(page.locator(".facts").text_content())
    assert broken_rules(page) == []


def test_frames_move_what_is_seen(page: Page, shown: Shown) -> None:
    before = picture(page)
    command = shown.simulation.duo.command()
    for step in range(15):
        shown.simulation.step(type(command)(joints=command.joints + 0.3, openings=command.openings))
        shown.frame(step)
    page.wait_for_timeout(300)
    assert difference(before, picture(page)) > 0.3


def test_browser_reads_tracks_as_they_were_written(page: Page) -> None:
    rng = np.random.default_rng(0)
    poses = np.cumsum(rng.normal(size=(50, 4, 7)) * 0.05, axis=0)
    poses[..., 3:] /= np.linalg.norm(poses[..., 3:], axis=-1, keepdims=True)
    track = encode(poses)
    read = page.evaluate(
        """async ([text, steps]) => {
          const { Track } = await import("/track.js");
          const track = await Track.read(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)));
          return [track.steps, track.bodies, steps.map((step) => [...track.at(step)])];
        }""",
        [base64.b64encode(track).decode(), [0, 17, 17.5, 49, 99]],
    )
    true = decode(track).reshape(50, -1)
    assert read[:2] == [50, 4]
    for ours, step in zip(read[2], (0, 17, None, 49, 49), strict=True):
        if step is not None:
            np.testing.assert_allclose(ours, true[step], atol=1e-6)
    between = np.array(read[2][2]).reshape(4, 7)
    expected = (true[17] + true[18]).reshape(4, 7) / 2
    np.testing.assert_allclose(between[:, :3], expected[:, :3], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(between[:, 3:], axis=1), 1, atol=1e-6)


def test_lost_connection_is_said_and_made_again(
    window: Browser, shown: Shown, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(access.secrets, "token_urlsafe", lambda _bytes: "same-token")
    other = PageServer(assets())
    port = int(re.search(r":(\d+)/", other.url)[1])  # type: ignore[index]
    other.publish_status(STATUS)
    other.publish_scene(shown.geometry.name, shown.geometry.data)
    # What a browser writes while nobody answers is no fault of the page.
    with opened(window, "about:blank", forgiven=("WebSocket",)) as page:
        page.goto(other.url)
        until(page, "document.querySelector('h1').textContent == 'transfer_cube'")
        other.close()
        until(page, "document.querySelector('.link').dataset.state == 'bad'")
        again = PageServer(assets(), port=port)
        again.publish_status({**STATUS, "title": "again"})
        until(page, "document.querySelector('h1').textContent == 'again'")
        assert page.locator(".link").text_content() == "Connected"
        page.evaluate("window.stop()")
        page.goto("about:blank")
        again.close()
