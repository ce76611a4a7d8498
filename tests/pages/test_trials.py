"""The page of the operator of real arms, in a browser."""

import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from dev.tools.pages import DESKTOP, PHONE, View
from duobench.core.types import Side
from duobench.policy import interruptible
from duobench.real.sessions.policy_runner import REASONS
from duobench.real.sessions.session import HELD_BY_OPERATOR
from duobench.real.sessions.trials_folder import LogKind
from duobench.results.labels import FaultKind
from tests.pages.windows import DARK_PHONE, broken_rules, opened, until
from tests.real.sessions import toys
from tests.real.sessions.operator import POLICIES, STEPS, Stand, records
from tests.web.pages import wait_until

LAST = 5
SMALLEST = 12
"""Height in pixels of a number on a footprint that can be read."""


class Led:
    """A session in a thread, whose page a browser has open."""

    def __init__(self, path: Path) -> None:
        # A browser on a busy machine may be busy for long.
        self.stand = Stand(path, POLICIES[:1], episodes=1, blind=True, silence_s=600.0)
        self.results: list[bool] = []
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self) -> None:
        self.results.append(self.stand.session.run())
        row = {"letter": "A", "policy": "mine", "trained_on": "sim", "episodes": 1}
        row |= {"successes": 1, "success_rate": 1.0, "wilson_95": [0.2065, 1.0]}
        row |= {"mean_final_progress": 1.0}
        self.stand.session.publish(results=[row], files="Report: index.html")

    def close(self) -> None:
        self.stand.session.stop()
        toys.Patient.gate.release(100)
        self.thread.join()
        self.stand.ending.close()


@pytest.fixture
def led(tmp_path: Path) -> Iterator[Led]:
    with closing(Led(tmp_path / "trials")) as led:
        yield led


def shown(page: Page, selector: str) -> None:
    page.wait_for_selector(f"{selector}:visible", timeout=60_000)


def start(page: Page) -> None:
    shown(page, "#placed")
    page.click("#placed")
    shown(page, "#start")
    page.click("#start")
    assert toys.Patient.waiting.acquire(timeout=toys.TIMEOUT_S)
    until(page, "document.querySelector('.state').textContent == 'The policy plays'")


def first_chunk() -> None:
    """Let the policy give its first commands; before them nothing counts."""
    toys.Patient.gate.release()
    assert toys.Patient.waiting.acquire(timeout=toys.TIMEOUT_S)


def stage(page: Page) -> int:
    return page.locator(".stage-keys [aria-pressed=true]").count()


@pytest.mark.parametrize("view", [DESKTOP, DARK_PHONE], ids=lambda view: view.name)
def test_no_rule_of_accessibility_is_broken(window: Browser, led: Led, view: View) -> None:
    with opened(window, led.stand.server.url, view) as page:
        shown(page, "#placed")
        until(page, "document.querySelector('#layout').naturalWidth == 1280")
        assert page.evaluate("document.documentElement.scrollWidth") == view.width
        numbers = page.locator("#outlines text").evaluate_all(
            "(all) => all.map((text) => text.getBoundingClientRect().height)"
        )
        assert min(numbers) > SMALLEST
        assert broken_rules(page) == []
        start(page)
        assert broken_rules(page) == []
        page.keyboard.press(str(LAST))
        until(page, "document.querySelectorAll('.stage-keys [aria-pressed=true]').length == 5")
        toys.Patient.gate.release()
        shown(page, "#finish")
        heights = page.locator("#at-end label").evaluate_all("(all) => all.map((l) => l.offsetHeight)")
        assert max(heights) < 2 * SMALLEST + 4, "each answer is one line"
        assert page.evaluate("document.documentElement.scrollWidth") == view.width
        assert broken_rules(page) == []
        page.click("#finish")
        until(page, "document.querySelector('.note').textContent.startsWith('Say first')")
        page.check("[name=holds][value=yes]")
        page.click("#finish")
        shown(page, "#over")
        assert broken_rules(page) == []
        assert "20.6–100.0" in (page.locator("#over tbody").text_content() or "")


def test_objects_are_placed_over_the_live_image(window: Browser, led: Led) -> None:
    with opened(window, led.stand.server.url) as page:
        shown(page, "#placed")
        until(page, "document.querySelector('#live').dataset.frames > 1")
        until(page, "document.querySelector('#layout').naturalWidth == 1280")
        assert page.locator("#outlines text").all_text_contents() == ["1", "2", "3", "4"]
        assert page.locator("#footprints tbody tr").count() == 4
        layout = page.locator("#layout")
        assert layout.evaluate("(image) => image.style.opacity") == "0.5"
        page.check("#difference")
        assert layout.evaluate("(image) => image.style.mixBlendMode") == "difference"
        page.uncheck("#difference")
        page.check("#flicker")
        until(page, "document.querySelector('#layout').hidden")
        until(page, "!document.querySelector('#layout').hidden")
        page.uncheck("#flicker")
        assert page.locator("#ghost").is_hidden()
        page.check("#show-ghost")
        until(page, "document.querySelector('#ghost').naturalWidth == 1280")
        page.check("#native")
        width = "document.querySelector('#live').getBoundingClientRect().width"
        assert page.evaluate(width) == 1280
        sheet = page.locator(".sheet a").get_attribute("href")
        answer = page.request.get(led.stand.server.url.split("/?")[0] + (sheet or ""))
        assert answer.headers["content-type"] == "application/pdf"


def test_keys_judge_and_undo(window: Browser, led: Led) -> None:
    with opened(window, led.stand.server.url) as page:
        start(page)
        for key, expected in (("1", 1), ("3", 3), ("2", 3), ("Backspace", 3), ("Backspace", 1)):
            count = page.locator(".presses li").count()
            page.keyboard.press(key)
            until(page, f"document.querySelectorAll('.presses li').length == {count + 1}")
            assert stage(page) == expected
        assert page.locator(".presses .gone").count() == 2
        toys.Patient.gate.release(STEPS)
        shown(page, "#finish")
        page.fill("#note", "2 was close ")  # no key of a stage while somebody types
        page.keyboard.press("Tab")
        page.click("#finish")
        shown(page, "#over")
    (record,) = records(led.stand.folder)["A"]
    assert record.final_stage == 1
    assert record.judged is not None
    assert record.judged.note == "2 was close"
    assert [press.stage for press in record.judged.presses] == [1, 3, 2, None, None]


def test_note_stays_and_closes_nothing(window: Browser, led: Led) -> None:
    with opened(window, led.stand.server.url) as page:
        start(page)
        toys.Patient.gate.release(STEPS)
        shown(page, "#finish")
        page.fill("#note", "The cube slipped.")
        page.press("#note", "Enter")
        wait_until(lambda: led.stand.session.note == "The cube slipped.")
        page.reload()
        shown(page, "#finish")
        assert page.input_value("#note") == "The cube slipped."
        page.click("#finish")
        shown(page, "#over")
    (record,) = records(led.stand.folder)["A"]
    assert record.judged is not None
    assert record.judged.note == "The cube slipped."


def test_space_bar_holds_whatever_has_the_focus(window: Browser, led: Led) -> None:
    with opened(window, led.stand.server.url, PHONE) as page:
        start(page)
        first_chunk()
        page.focus(".stage-keys button")
        page.keyboard.press("Space")
        for _ in range(500):
            if led.stand.duo.held is not None:
                break
            page.wait_for_timeout(20)
        assert led.stand.duo.held == HELD_BY_OPERATOR
        assert stage(page) == 0
        toys.Patient.gate.release()
        shown(page, "#invalid")
        page.click("#invalid")
        until(page, "document.querySelector('.note').textContent.startsWith('Say why')")
        page.fill("#reason", "A cup fell.")
        page.click("#invalid")
        until(page, "document.querySelector('.where').textContent.includes('attempt 2')")
    kinds = [entry.kind for entry in led.stand.folder.read_log()]
    assert kinds[:5] == [LogKind.BEGIN, LogKind.PLACED, LogKind.START, LogKind.HOLD, LogKind.END]


def test_emergency_stop_is_asked_about_and_cannot_count(window: Browser, led: Led) -> None:
    with opened(window, led.stand.server.url) as page:
        start(page)
        first_chunk()
        assert "policy hidden" in (page.locator(".where").text_content() or "")
        led.stand.duo.arms[Side.LEFT].fail("User Stop", FaultKind.PERSON)  # type: ignore[attr-defined]
        toys.Patient.gate.release()
        shown(page, "#invalid")
        assert page.locator("#finish").is_disabled()
        assert "never counts" in (page.locator(".note").text_content() or "")
        offered = "[...document.querySelectorAll('#reasons option')].map((one) => one.value)"
        assert page.evaluate(offered) == list(REASONS[FaultKind.PERSON])
        assert broken_rules(page) == []
        page.fill("#reason", REASONS[FaultKind.PERSON][1])
        page.click("#invalid")
        until(page, "document.querySelector('.where').textContent.includes('attempt 2')")
        assert page.evaluate(offered) != list(REASONS[FaultKind.PERSON])


def test_policy_that_does_not_answer_is_given_up(
    window: Browser, led: Led, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interruptible, "PATIENCE_S", 0.1)
    with opened(window, led.stand.server.url) as page:
        start(page)
        shown(page, "#give_up")
        assert broken_rules(page) == []
        page.click("#give_up")
        shown(page, "#finish")
        assert page.locator("#give_up").is_hidden()
        assert interruptible.GIVEN_UP in (page.locator(".note").text_content() or "")


def test_second_browser_watches(window: Browser, led: Led) -> None:
    with (
        opened(window, led.stand.server.url) as page,
        opened(window, led.stand.server.url) as other,
    ):
        shown(page, "#placed")
        until(other, "document.querySelector('.role').textContent.startsWith('You watch')")
        assert other.locator("#placed").is_hidden()
        other.click("#hold")
        wait_until(lambda: led.stand.duo.held == HELD_BY_OPERATOR)
        other.click(".role button")
        until(page, "!document.querySelector('#placed')")
        shown(other, "#placed")


def test_who_watched_operates_once_the_other_window_is_closed(window: Browser, led: Led) -> None:
    with opened(window, led.stand.server.url) as other:
        with opened(window, led.stand.server.url) as page:
            shown(other, "#placed")
            page.click(".role button")
            shown(page, "#placed")
        other.click(".role button")
        shown(other, "#placed")


def test_stages_are_corrected_from_the_film(window: Browser, led: Led) -> None:
    with opened(window, led.stand.server.url, PHONE) as page:
        start(page)
        page.keyboard.press("2")
        toys.Patient.gate.release(STEPS)
        until(page, "document.querySelector('video').readyState >= 2")
        assert page.evaluate("document.documentElement.scrollWidth") == PHONE.width
        assert broken_rules(page) == []
        page.click("#undo")
        page.evaluate("document.querySelector('video').currentTime = 0.4")
        until(page, "!document.querySelector('video').seeking")
        page.keyboard.press("3")
        until(page, "document.querySelectorAll('.presses li').length == 3")
        page.click("#finish")
        shown(page, "#over")
    (record,) = records(led.stand.folder)["A"]
    assert record.stage_changes == ((12, 3),)
    assert record.judged is not None
    assert [(press.stage, press.step) for press in record.judged.presses] == [
        (2, 0),
        (None, STEPS),
        (3, 12),
    ]
