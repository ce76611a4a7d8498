"""Look at HTML pages as a reader does: in a browser on a desktop, a phone and paper; and by rules.

It drives Chromium without a window, which the machine must have as `chromium`, `chromium-browser`
or `google-chrome`. Accessibility is checked by axe-core, which `make test-pages` installs.

    python -m dev.tools.pages RUN/index.html --out FOLDER
"""

from __future__ import annotations

import argparse
import html
import json
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
TIMEOUT_S = 180
"""Seconds that the browser may take for one page."""
_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--hide-scrollbars",
    "--disable-background-networking",
    "--no-first-run",
    "--virtual-time-budget=30000",
)


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """How a page is looked at."""

    name: str
    """What it is called."""
    width: int
    """Width of the window in CSS pixels."""
    height: int
    """Its height."""
    is_dark: bool = False
    """Whether the reader prefers a dark page."""


DESKTOP = View(name="desktop", width=1280, height=900)
PHONE = View(name="phone", width=390, height=844)
DARK = View(name="dark", width=1280, height=900, is_dark=True)
VIEWS = (DESKTOP, PHONE, DARK)

_FRAME = """<!doctype html><title>frame</title><style>body {{ margin: 0; }}
iframe {{ border: 0; display: block; width: {width}px; height: {height}px; }}</style>
<iframe src="{page}"></iframe><pre id="answer"></pre><script>
addEventListener("message", (event) => {{ answer.textContent = event.data; }});
</script>"""
_OPEN = "for (const part of document.querySelectorAll('details')) part.open = true;"
_TELL = "parent.postMessage(JSON.stringify({}), '*')"
_AXE = f"""{_OPEN}
axe.run(document, {{resultTypes: ["violations"]}}).then(
  (found) => {_TELL.format("found.violations")},
  (error) => {_TELL.format("[{id: String(error)}]")});
"""


class NoBrowserError(RuntimeError):
    """The machine has no Chromium, or it did not answer."""


def browser() -> str:
    """The browser of this machine.

    Raises:
        NoBrowserError: There is none.
    """
    for name in BROWSERS:
        if path := shutil.which(name):
            return path
    raise NoBrowserError(f"No browser: install one of {', '.join(BROWSERS)}.")


def violations(page: Path, axe: Path, view: View) -> list[dict[str, Any]]:
    """The rules of accessibility that a page breaks, with everything on it unfolded.

    Args:
        page: The page.
        axe: The script of axe-core, `axe.min.js`.
        view: How it is looked at.

    Returns:
        What axe-core gives: a rule's `id`, `help`, and the `nodes` that break it.

    Raises:
        NoBrowserError: There is no browser, or no answer.
    """
    script = f"<script>{axe.read_text(encoding='utf-8')}</script><script>{_AXE}</script>"
    return json.loads(_answer(page, view, script))


def measure(page: Path, view: View, expression: str) -> Any:
    """The value of a JavaScript expression on a page, by way of JSON.

    Raises:
        NoBrowserError: There is no browser, or no answer.
    """
    script = f"<script>addEventListener('load', () => {_TELL.format(expression)});</script>"
    return json.loads(_answer(page, view, script))


def screenshot(page: Path, view: View, target: Path, *, unfolded: bool = False) -> None:
    """Write what a view shows of a page as a PNG file.

    Args:
        page: The page.
        view: How it is looked at; a tall one shows more of the page.
        target: The file.
        unfolded: Whether everything on the page is unfolded.

    Raises:
        NoBrowserError: There is no browser, or it wrote nothing.
    """
    with _framed(page, view, f"<script>{_OPEN}</script>" * unfolded) as frame:
        size = f"--window-size={max(view.width, 500)},{view.height}"
        _run(size, f"--screenshot={target.absolute()}", frame.as_uri())
    if not target.exists():
        raise NoBrowserError(f"The browser wrote no {target}.")


def paper(page: Path, target: Path) -> None:
    """Print a page into a PDF file.

    Raises:
        NoBrowserError: There is no browser, or it wrote nothing.
    """
    _run("--no-pdf-header-footer", f"--print-to-pdf={target.absolute()}", page.absolute().as_uri())
    if not target.exists():
        raise NoBrowserError(f"The browser wrote no {target}.")


def _answer(page: Path, view: View, script: str) -> str:
    """What a script on a page tells."""
    with _framed(page, view, script) as frame:
        dom = _run(
            "--dump-dom", f"--window-size={max(view.width, 500)},{view.height}", frame.as_uri()
        )
    found = re.search(r'<pre id="answer">(.*?)</pre>', dom, re.DOTALL)
    if not (found and found[1]):
        raise NoBrowserError(f"The browser did not answer about {page}.")
    return html.unescape(found[1])


@contextmanager
def _framed(page: Path, view: View, script: str) -> Iterator[Path]:
    """A page that shows a copy of another one, with a script at its end, in a frame.

    A window cannot be as narrow as a phone, but a frame can. The copy stands beside the page, so
    that its links lead to the same files.
    """
    text = page.read_text(encoding="utf-8")
    if view.is_dark:
        text = text.replace("(prefers-color-scheme: dark)", "all")
    with tempfile.TemporaryDirectory(dir=page.absolute().parent) as folder:
        copy = page.absolute().with_name(f"{Path(folder).name}.html")
        copy.write_text(text.replace("</body>", f"{script}</body>"), encoding="utf-8")
        frame = Path(folder, "frame.html")
        frame.write_text(
            _FRAME.format(width=view.width, height=view.height, page=copy.as_uri()), "utf-8"
        )
        try:
            yield frame
        finally:
            copy.unlink()


def _run(*arguments: str) -> str:
    """Start the browser with a profile of its own, and return what it prints."""
    with tempfile.TemporaryDirectory() as profile:
        command = [browser(), *_FLAGS, f"--user-data-dir={profile}", *arguments]
        try:
            done = subprocess.run(
                command, check=True, capture_output=True, timeout=TIMEOUT_S, encoding="utf-8"
            )
        except (subprocess.SubprocessError, OSError) as error:
            raise NoBrowserError(f"The browser failed: {error}") from error
    return done.stdout


def main() -> None:
    """Write a page as it looks on a desktop, a phone and paper."""
    parser = argparse.ArgumentParser(prog="python -m dev.tools.pages", description=__doc__)
    parser.add_argument("page", type=Path, nargs="+", help="HTML files")
    parser.add_argument("--out", type=Path, required=True, help="folder for images and PDF files")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for page in arguments.page:
        name = f"{page.absolute().parent.name}-{page.stem}"
        for view in VIEWS:
            target = arguments.out / f"{name}-{view.name}.png"
            screenshot(page, view, target)
            print(target)
        target = arguments.out / f"{name}-paper.pdf"
        paper(page, target)
        print(target)


if __name__ == "__main__":
    main()
