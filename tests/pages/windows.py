"""Windows of a real browser that draws in 3D, on a processor, and note every complaint."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, ConsoleMessage, Page, sync_playwright

from dev.tools.pages import DARK, DESKTOP, PHONE, View, browser

FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
TRIES = 300
DARK_PHONE = View(name="dark phone", width=390, height=844, is_dark=True)
VIEWS = (DESKTOP, DARK, PHONE, DARK_PHONE)


@contextmanager
def started() -> Iterator[Browser]:
    """A browser."""
    with sync_playwright() as play:
        window = play.chromium.launch(executable_path=browser(), args=[*FLAGS])
        yield window
        window.close()


@contextmanager
def opened(
    window: Browser,
    url: str,
    view: View = DESKTOP,
    *,
    script: str = "",
    forgiven: tuple[str, ...] = (),
) -> Iterator[Page]:
    """A page; whoever opens it fails with the first error or warning that it writes.

    A script runs before those of the page. Lines with a forgiven word are none of its errors.
    """
    context = window.new_context(
        viewport={"width": view.width, "height": view.height},
        color_scheme="dark" if view.is_dark else "light",
        has_touch=view.width < 500,
        reduced_motion="reduce",
    )
    if script:
        context.add_init_script(script)
    page = context.new_page()
    complaints = complaints_of(page)
    try:
        page.goto(url)
        yield page
        assert [line for line in complaints if not any(map(line.count, forgiven))] == []
    finally:
        context.close()


def complaints_of(page: Page) -> list[str]:
    """What a page says on its console from now on that it should not, and what it throws."""
    found: list[str] = []

    def note(line: ConsoleMessage) -> None:
        if line.type in {"error", "warning"} and "GPU stall" not in line.text:
            found.append(line.text)

    page.on("pageerror", lambda error: found.append(str(error)))
    page.on("console", note)
    return found


def broken_rules(page: Page) -> list[tuple[str, list[str]]]:
    """The rules of accessibility that a page breaks, and where."""
    page.add_script_tag(content=Path(os.environ["DUOBENCH_AXE"]).read_text(encoding="utf-8"))
    found: dict[str, Any] = page.evaluate("axe.run(document, {resultTypes: ['violations']})")
    return [(each["id"], [node["html"] for node in each["nodes"]]) for each in found["violations"]]


def until(page: Page, expression: str) -> None:
    """Wait until a JavaScript expression is true; works where a page forbids `eval`."""
    for _ in range(TRIES):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(30)
    raise AssertionError(f"never true: {expression}")


def picture(page: Page) -> NDArray[np.int16]:
    """What the canvas shows (height, width, 3), after it was drawn."""
    page.evaluate("() => new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))")
    with Image.open(io.BytesIO(page.locator("canvas").first.screenshot())) as image:
        return np.asarray(image.convert("RGB")).astype(np.int16)


def difference(one: NDArray[np.int16], other: NDArray[np.int16]) -> float:
    """Mean difference of two pictures, 0 to 255."""
    return float(np.abs(one - other).mean())
