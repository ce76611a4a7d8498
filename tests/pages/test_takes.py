"""A second look at recorded takes, in a browser: one click takes a take out of the next export."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from threading import Thread

import pytest
from playwright.sync_api import Browser, Page

from dev.tools.pages import DESKTOP, View
from duobench.data import Actor, ActorKind, DataSet, ExportOptions, Recorder
from duobench.data.lerobot.export import export_lerobot
from duobench.evaluation.replay.sources import DataSource
from duobench.evaluation.replay.viewer import Viewer
from duobench.web.page import assets
from duobench.web.server import PageServer
from tests.data.tools import HORIZON, TASK, play, recorder
from tests.pages.windows import VIEWS, broken_rules, opened, until

TAKES = 3


@pytest.fixture
def data(tmp_path: Path) -> DataSet:
    """Three takes of two people, none of them solved, and one of these kept by mistake."""
    env: Recorder = recorder(tmp_path / "people", split="train")
    for number in range(TAKES):
        name = "P07" if number else "P11"
        env.actor = Actor(kind=ActorKind.PERSON, name=name, device="mouse")
        play(env, seed=number)
    env.close()
    return DataSet.open(tmp_path / "people")


@contextmanager
def shown(window: Browser, data: DataSet, view: View = DESKTOP) -> Iterator[Page]:
    """The page of `duobench view DATA`."""
    with closing(PageServer(assets())) as server:
        source = DataSource(data)
        viewer = Viewer(source, server, source.refresh)
        thread = Thread(target=viewer.run)
        thread.start()
        try:
            with opened(window, server.url, view) as page:
                until(page, f"document.querySelectorAll('#takes tbody tr').length == {TAKES}")
                until(page, "!document.querySelector('.timeline').hidden")
                yield page
        finally:
            viewer.stop()
            thread.join()


def facts(page: Page, words: str) -> None:
    until(page, f"document.querySelector('#take').textContent.includes('{words}')")


def exported(data: DataSet, out: Path) -> list[str]:
    options = ExportOptions(cameras=(), keep_failures=True)
    export_lerobot(data, out, options, workers=0)
    about = json.loads((out / "meta" / "duobench.json").read_text())
    return [Path(each["file"]).stem for each in about["episodes"]]


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.name)
def test_takes_break_no_rule_of_accessibility(window: Browser, data: DataSet, view: View) -> None:
    with shown(window, data, view) as page:
        assert broken_rules(page) == []
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_a_take_kept_by_mistake_is_out_of_the_next_export_after_one_click(
    window: Browser, data: DataSet, tmp_path: Path
) -> None:
    before = [path.read_bytes() for path in data.episodes()]
    with shown(window, data) as page:
        facts(page, "kept, not exported")
        page.get_by_role("button", name="Discard Backspace").click()
        facts(page, "Discarded at a second look.")
        assert exported(data, tmp_path / "next") == ["00001", "00002"]
        page.get_by_role("button", name="Undo P").click()
        until(page, "document.querySelector('#take h2 + p').textContent.startsWith('kept')")
        assert exported(data, tmp_path / "after") == ["00000", "00001", "00002"]
    assert [path.read_bytes() for path in data.episodes()] == before


def test_keys_say_the_same_about_the_take_that_is_shown(window: Browser, data: DataSet) -> None:
    with shown(window, data) as page:
        page.locator("#takes").get_by_label("Operator").select_option("P07")
        until(page, "document.querySelectorAll('#takes tbody tr').length == 2")
        page.get_by_label("Your pseudonym").fill("P23")
        page.get_by_label("Note").fill("y")  # what is typed decides nothing
        page.keyboard.press("Enter")
        facts(page, "P23")
        page.locator("canvas").focus()
        page.keyboard.press(".")
        facts(page, f"{TASK} 00001")
        page.keyboard.press("Backspace")
        facts(page, "not to be used")
        page.keyboard.press("y")
        facts(page, "kept, not exported")
        until(page, "document.querySelector('.timeline input').max == '40'")
        page.get_by_text("Paused", exact=True).wait_for()  # it was played to its end
        for key, step in (("i", 4), ("o", 20)):
            page.locator(".timeline input").fill(str(step))
            page.keyboard.press(key)
            until(page, f"document.querySelector('#take').textContent.includes('{step / 30:.1f}')")
        page.keyboard.press("p")
        facts(page, f"0.1 to {HORIZON / 30:.1f} s")
    reviews = data.reviews
    first, second, _ = map(reviews.of, data.episodes())
    assert (first.note, first.by, first.kept) == ("y", "P23", None)
    assert (second.kept, second.rows) == (True, (4, HORIZON))
