"""Whether what people read in the folder of a run is what its records give."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from html import unescape
from typing import Any

from duobench.errors import escaped
from duobench.results.folder import RunFolder
from duobench.results.pages import PAGE, software
from duobench.results.report import report_files
from duobench.results.scores import RunPart

_LONGEST = 200  # characters of what is quoted
_TAG = re.compile(r"<[^<>]*>")
_HEADLINE = re.compile(r"<dt>([^<]*)</dt><dd>([^<]*)<small")
_NUMBERS = re.compile(r"[\d.,–()%/ of-]+")


def check_report(folder: RunFolder, parts: Sequence[RunPart]) -> tuple[list[str], list[str]]:
    """Compare every file of a report in the folder of a run with what would be written there.

    Videos are those that a page shows, and so are replays, as far as they are there. Beside a page
    of other software only numbers that both have are compared: headlines and cells of tables.

    Returns:
        What differs, one sentence a file, and the pages of other software.
    """
    left = {name: folder.file(name).read_text("utf-8", "replace") for name in folder.report()}
    pages = {name: text for name, text in left.items() if name.endswith(PAGE)}
    others = [name for name, text in pages.items() if software() not in text]
    wrong: list[str] = []
    for name, text in report_files(folder, folder, parts, pages) if left else ():
        is_other = re.sub(r"(figures/)?[^/]+$", PAGE, name) in others
        if name in left and (words := _difference(name, left.pop(name), text, is_other)):
            wrong.append(f"{name} {words}; duobench report writes it anew.")
    return wrong + [f"{name} is no part of this run's report; remove it." for name in left], others


def _difference(name: str, said: str, given: str, is_other: bool) -> str:
    """In what a file differs first, in words; empty for nothing."""
    claims, facts = (_claims(name, text, is_other) for text in (said, given))
    both = [place for place in facts if place in claims]
    if is_other and facts and not both:
        return "has none of the numbers that its records give"
    for place in both if is_other else {**facts, **claims}:
        claim, fact = (" ".join(each.get(place, "").split()) for each in (claims, facts))
        if claim != fact:
            claim, fact = (escaped(text[:_LONGEST] or "nothing") for text in (claim, fact))
            return f"says “{claim}”, its records give “{fact}”"
    if is_other or name.endswith(".json") or said.splitlines() == given.splitlines():
        return ""
    return "differs in a figure, a style or a script from what its records give"


def _claims(name: str, text: str, is_other: bool) -> Mapping[Any, str]:
    """What a file says by where it says it: value by value, or line by line."""
    if name.endswith(".json"):
        with suppress(ValueError, RecursionError):
            return dict(_leaves(json.loads(text, parse_float=_number, object_pairs_hook=_object)))
    if is_other:
        numbers = re.findall(r"\d[\d.]*", "" if name.endswith(".svg") else text)
        return dict(_cells(text) if name.endswith(".html") else enumerate(numbers))
    return dict(enumerate(unescape(_TAG.sub(" ", text)).splitlines()))


def _number(text: str) -> float:
    return float(f"{float(text):.9g}")  # the last bits of a logarithm are a processor's own


def _object(pairs: list[tuple[str, Any]]) -> object:
    return found if len(found := dict(pairs)) == len(pairs) else pairs  # where one is there twice


def _leaves(
    value: dict[str, Any] | list[Any] | float | str | None, place: str = ""
) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict | list) and value:
        for name, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(part, f"{place}{name} ")
    else:
        yield place, f"{place}{json.dumps(value, ensure_ascii=False)}"


def _cells(page: str) -> Iterator[tuple[object, str]]:
    """Headline numbers of a page, and numbers in tables by table, row and column."""
    yield from ((name, f"{name} {value}") for name, value in _HEADLINE.findall(page))
    for part in page.split(' aria-label="'):
        label, _, table = part.partition("</table>")[0].partition('"><table')
        head, _, body = table.partition("</thead>")
        columns = _row(head.rpartition("<tr")[2])
        for cells in map(_row, body.split("<tr")):
            for column, cell in zip(columns, cells, strict=False):
                if _NUMBERS.fullmatch(cell):
                    yield (label, cells[0], column), f"{label}: {cells[0]}, {column} {cell}"


def _row(text: str) -> list[str]:
    return [_plain(cell) for cell in re.split(r"<t[hd]\b[^>]*>", text)[1:]]


def _plain(text: str) -> str:
    """Text as a person reads it, without markup."""
    return " ".join(unescape(_TAG.sub(" ", text)).split())
