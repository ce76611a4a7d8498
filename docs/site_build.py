"""Build the site in `site/html`: every warning is an error.

`make site` runs it, and then the tests of what is built.
"""

import argparse
import re
import shutil
import sys
from pathlib import Path

DOCS = Path(__file__).parent
ROOT = DOCS.parent
sys.path.append(str(ROOT))  # for tests/ways, whose names say what must not count

from site_stage import stage  # noqa: E402
from sphinx.cmd.build import build_main  # noqa: E402

MENDED = (
    (r"<pre>", '<pre tabindex="0">'),
    (r'<div class="table-wrapper', '<div tabindex="0" class="table-wrapper'),
    (
        r'<aside class="sidebar-drawer',
        '<aside aria-label="All pages" class="sidebar-drawer',
    ),
    (r'<div id="search-results">', '<h1>Search</h1><div id="search-results">'),
    (r'<aside class="toc-drawer', '<aside aria-label="On this page" class="toc-drawer'),
    (r"(?s)<dl>\n((?:<dd>.*?</dd>\n)+)</dl>", r'<span class="sig-lines">\1</span>'),
)
"""What the theme's pages need so that keys reach all that scrolls, regions have names of their own,
the search has a heading, and a signature of several lines is no list without terms."""
LINE = (r"(?s)<dd>(.*?)</dd>", r'<span class="sig-line">\1</span>')
"""A line of such a signature."""


def mend(page: Path) -> None:
    """Make a page accessible where the theme does not."""
    text = page.read_text(encoding="utf-8")
    for pattern, new in MENDED:
        text = re.sub(pattern, new, text)
    lines = r'(?s)<span class="sig-lines">.*?</dd>\n</span>'
    text = re.sub(lines, lambda found: re.sub(*LINE, found[0]), text)
    page.write_text(text, encoding="utf-8")


def main() -> None:
    """Lay out what Sphinx reads, run it, and mend its pages."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--out", type=Path, default=ROOT / "site", help="folder of all of it"
    )
    out: Path = parser.parse_args().out
    source, extra, built = out / "source", out / "extra", out / "html"
    stage(source, extra)
    shutil.rmtree(built, ignore_errors=True)  # pages that are no more
    words = [
        "-b",
        "html",
        "-c",
        str(DOCS),
        "-d",
        str(out / "doctrees"),
        "-W",
        "--keep-going",
        "-q",
    ]
    if code := build_main(
        [*words, "-D", f"html_extra_path={extra}", str(source), str(built)]
    ):
        sys.exit(code)
    for page in built.rglob("*.html"):
        if page.parent.name != "replays":
            mend(page)


if __name__ == "__main__":
    main()
