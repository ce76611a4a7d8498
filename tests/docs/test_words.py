"""The pages stay short: what a person has to read, together, has a bound.

A word is what stands between spaces and has a letter or a digit, also in blocks of code, in tables
and in links. Not counted are what is written from the code (pages of `GENERATED`, and places of
`docs/tables.py`), the notices of other works, and what only looks like text (a table's lines).
"""

from __future__ import annotations

import re
from pathlib import Path

import gallery_page
import prints_page
import pytest
from tables import PLACE

from tests.docs.markdown import PAGES, ROOT, text_of

COMMENT = re.compile(r"<!--.*?-->")
MOST_WORDS = 36_350
"""36,000, and 350 for the page of other hardware."""
MOST_WORDS_OF_A_PAGE = 2_500
NOTICES = "THIRD_PARTY_NOTICES.md"
GENERATED = {gallery_page.PAGE, prints_page.PAGE}
READ = [
    page
    for page in (*PAGES, *sorted(ROOT.glob("plugins/*/README.md")))
    if page.name not in {NOTICES, *GENERATED}
]


def words(text: str) -> int:
    """The words of a page in Markdown that somebody wrote."""
    return sum(1 for each in COMMENT.sub("", PLACE.sub("", text)).split() if re.search(r"\w", each))


def test_all_pages_together_are_short() -> None:
    counted = {str(page.relative_to(ROOT)): words(text_of(page)) for page in READ}
    assert len(counted) > 20
    assert 0 < sum(counted.values()) <= MOST_WORDS, sorted(counted.items(), key=lambda at: -at[1])


@pytest.mark.parametrize("page", READ, ids=lambda page: page.name)
def test_a_page_is_short(page: Path) -> None:
    assert words(text_of(page)) <= MOST_WORDS_OF_A_PAGE


def test_what_is_written_from_code_does_not_count() -> None:
    place = "<!-- any: written by make docs -->\n\none two\n<!-- end of any -->\n"
    assert (
        words(f"# A page\n\n| a | b |\n| --- | --- |\n\n{place}`x = 1`, [link](there.md).\n") == 7
    )
