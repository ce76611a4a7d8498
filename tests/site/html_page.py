"""A page of the site, as far as tests ask: its links, its anchors, its text."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

SITE = Path(os.environ.get("DUOBENCH_SITE", "site/html")).absolute()
LEADS = {"a": "href", "link": "href", "img": "src", "script": "src", "source": "src"}
"""What names another file, by the element."""


@dataclass
class HtmlPage(HTMLParser):
    """What is on a page."""

    path: Path
    links: list[str] = field(default_factory=list)
    """Where its own text leads, without the frame that every page has."""
    files: list[str] = field(default_factory=list)
    """All that it names: links, pictures, styles, scripts."""
    anchors: set[str] = field(default_factory=set)
    words: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self._inside = 0
        self.feed(self.path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self._inside += tag == "article"
        if "id" in given:
            self.anchors.add(given["id"])
        if found := given.get(LEADS.get(tag, "")):
            self.files.append(found)
            if tag == "a" and self._inside:
                self.links.append(found)

    def handle_endtag(self, tag: str) -> None:
        self._inside -= tag == "article"

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.words.append(data)

    @property
    def text(self) -> str:
        return "".join(self.words)

    def leads_to(self, link: str) -> Path:
        """The file that a link names."""
        return Path(os.path.normpath(self.path.parent / link.partition("#")[0].partition("?")[0]))


@cache
def read(path: Path) -> HtmlPage:
    return HtmlPage(path)
