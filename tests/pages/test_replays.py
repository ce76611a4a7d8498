from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page

from dev.tools.pages import PHONE, View
from duobench.tasks import get
from duobench.web.geometry import Geometry
from duobench.web.page import EpisodeReplay, replay_page
from duobench.web.track import encode
from duobench.world.robot import cameras
from duobench.world.robot.frames import robot_with
from duobench.world.sim import placement
from duobench.world.sim.rendering import Renderer
from duobench.world.sim.simulation import Simulation
from tests.pages.windows import VIEWS, broken_rules, difference, opened, picture, until

TASKS = ("bin_sort", "pour_marbles", "spring_door")
HAND = "franka_hand"
"""An episode of the first task with another gripper, whose fingers are seen from near."""
NEAR = cameras.View(eye=(0.85, 0.45, 0.7), target=(0.48, 0.21, 0.64), fovy_deg=30.0)
STEPS = 40
RENDERED = (480, 720)
CHANGES = ((10, 1), (30, 2))
_SEEK = """(step) => {
  const slider = document.querySelector(".timeline input");
  slider.value = step;
  slider.dispatchEvent(new Event("input", {bubbles: true}));
}"""


@pytest.fixture(scope="module")
def replays(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with an episode of each task, and beside it images of how each begins and ends."""
    page = tmp_path_factory.mktemp("replays") / "page.html"
    scenes, episodes = {}, []
    for id in (*TASKS, HAND):
        task = get(TASKS[0] if id == HAND else id)
        simulation = Simulation(task.props, task.overview)
        if id == HAND:
            simulation = Simulation(task.props, NEAR, robot_with(HAND))
        placement.first_valid(simulation, task.layouts(0), task.id)
        geometry = Geometry(simulation.model)
        with Renderer(simulation.model, height=RENDERED[0], width=RENDERED[1]) as renderer:
            image = renderer.render(simulation.data, "overview")
        Image.fromarray(image).save(page.with_name(f"{id}.png"))
        command, poses = simulation.duo.command(), []
        for step in range(STEPS):
            poses.append(geometry.poses(simulation.data))
            simulation.step(replace(command, joints=command.joints + 0.01 * step))
        scenes[geometry.name] = geometry.data
        episodes.append(
            EpisodeReplay(
                title=f"{id}, episode 0",
                scene=geometry.name,
                track=encode(np.array(poses)),
                stages=("first", "second", "third"),
                stage_changes=CHANGES,
                instruction=f"Play {id}.",
                id=id,
            )
        )
    page.write_text(replay_page("Some episodes", scenes, episodes), encoding="utf-8")
    return page


@pytest.fixture
def page(window: Browser, replays: Path) -> Iterator[Page]:
    with opened(window, replays.as_uri()) as page:
        page.wait_for_selector(f"[data-shown={TASKS[0]}]")
        yield page


def show(page: Page, id: str) -> None:
    page.click(f"[data-replay={id}]")
    page.wait_for_selector(f"[data-shown={id}]")


def value(page: Page) -> int:
    return int(page.locator(".timeline input").input_value())


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.name)
def test_no_rule_of_accessibility_is_broken(window: Browser, replays: Path, view: View) -> None:
    with opened(window, replays.as_uri(), view) as page:
        page.wait_for_selector("[data-shown]")
        assert broken_rules(page) == []


def test_phone_shows_no_more_than_its_width(window: Browser, replays: Path) -> None:
    with opened(window, replays.as_uri(), PHONE) as page:
        page.wait_for_selector("[data-shown]")
        assert page.evaluate("document.documentElement.scrollWidth") == PHONE.width


@pytest.mark.parametrize("id", [*TASKS, HAND])
def test_it_looks_like_the_renderer(page: Page, replays: Path, id: str) -> None:
    height, width = RENDERED
    show(page, id)
    page.locator("canvas").evaluate(
        f"""(canvas) => {{ canvas.style = "position: fixed; inset: 0 auto auto 0; max-height: none;"
          + "width: {width}px; height: {height}px; border-radius: 0"; }}"""
    )
    with Image.open(replays.with_name(f"{id}.png")) as image:
        rendered = np.asarray(image).astype(np.int16)
    ours = picture(page)
    assert ours.shape == rendered.shape
    assert difference(ours, rendered) < 5
    # Whatever is wrong with colours, lights or the camera changes more than edges.
    assert np.percentile(np.abs(ours - rendered).max(axis=2), 90) < 12


def test_slider_shows_the_episode_at_its_time(page: Page) -> None:
    first = picture(page)
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 1000
    page.evaluate(_SEEK, STEPS - 1)
    last = picture(page)
    assert difference(first, last) > 0.5
    page.evaluate(_SEEK, 0)
    assert difference(first, picture(page)) == 0
    page.evaluate(_SEEK, 12)
    said = page.locator(".timeline input").get_attribute("aria-valuetext")
    assert said == "0.4 s of 1.3 s, stage 1 of 3"
    assert page.locator(".said").text_content() == "Stage 1 reached: first"


def test_chips_and_marks_say_when_stages_were_reached(page: Page) -> None:
    assert page.locator(".marks i").all_text_contents() == ["1", "2"]
    states = page.locator(".stage-chip").evaluate_all("(chips) => chips.map(c => c.dataset.state)")
    assert states == ["later", "later", "open"]
    page.click(".stage-chip:has-text('second')")
    assert value(page) == CHANGES[1][0]
    assert page.locator(".stage-chip[data-state=reached]").count() == 2
    assert page.locator(".stage-chip:has-text('third')").is_disabled()


def test_it_plays_to_the_end_at_the_chosen_speed_and_by_keys_alone(page: Page) -> None:
    page.select_option(".speed", "4")
    page.locator("canvas").focus()
    page.keyboard.press("Space")
    until(page, f"document.querySelector('.timeline input').value == {STEPS - 1}")
    until(page, "document.querySelector('.play').textContent == 'Play'")
    page.locator(".timeline input").focus()
    page.keyboard.press("ArrowLeft")
    assert value(page) == STEPS - 2
    page.locator(f"[data-replay={TASKS[2]}]").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector(f"[data-shown={TASKS[2]}]")
    assert page.locator(".instruction").text_content() == f"Play {TASKS[2]}."
    assert page.locator("[aria-pressed=true]").count() == 1


def test_camera_turns_by_mouse_and_keys_and_goes_back(page: Page) -> None:
    first = picture(page)
    box = page.locator("canvas").bounding_box()
    assert box
    page.mouse.move(box["x"] + 300, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 420, box["y"] + 240, steps=4)
    page.mouse.up()
    turned = picture(page)
    assert difference(first, turned) > 3
    page.keyboard.press("ArrowRight")
    page.keyboard.press("+")
    assert difference(turned, picture(page)) > 3
    page.keyboard.press("0")
    page.locator("h1").click()  # away from the canvas, whose focus is seen
    assert difference(first, picture(page)) < 0.1


def test_graphics_are_made_once_and_not_before_an_episode_is_opened(
    window: Browser, replays: Path
) -> None:
    closed = replays.with_name("closed.html")
    closed.write_text(replays.read_text("utf-8").replace(" data-open ", " "), encoding="utf-8")
    with opened(window, "about:blank") as page:
        page.add_init_script(
            """window.made = new Set();
            const get = HTMLCanvasElement.prototype.getContext;
            HTMLCanvasElement.prototype.getContext = function (...options) {
              const context = get.apply(this, options);
              window.made.add(context);
              return context;
            };"""
        )
        page.goto(closed.as_uri())
        page.wait_for_selector(f"[data-replay={TASKS[0]}]")
        assert page.evaluate("window.made.size") == 0
        for id in TASKS:
            show(page, id)
        assert page.evaluate("window.made.size") == 1


def test_lost_graphics_come_back(page: Page) -> None:
    first = picture(page)
    page.evaluate(
        """async () => {
          const canvas = document.querySelector("canvas");
          const lose = canvas.getContext("webgl2").getExtension("WEBGL_lose_context");
          const wait = (name) => new Promise((r) => canvas.addEventListener(name, r, {once: true}));
          lose.loseContext();
          await wait("webglcontextlost");
          setTimeout(() => lose.restoreContext(), 50);
          await wait("webglcontextrestored");
        }"""
    )
    assert difference(first, picture(page)) < 0.1


def test_browser_without_graphics_is_told(window: Browser, replays: Path) -> None:
    with opened(window, "about:blank") as page:
        page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null;")
        page.goto(replays.as_uri())
        page.wait_for_selector(".problem:visible")
        assert "WebGL 2" in (page.locator(".problem").text_content() or "")
