"""Whether what people read in the folder of a run is what its records give."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from html import unescape
from typing import Any

from duobench.errors import escaped
from duobench.results.folder import RunFolder
from duobench.results.pages import PAGE, SOFTWARE
from duobench.results.report import report_files
from duobench.results.scores import RunPart

_LONGEST = 200  # characters of what is quoted
_HEADLINE = re.compile(r"<dt>([^<]*)</dt><dd>([^<]*)<small")
_NUMBERS = re.compile(r"[\d.,–()%/ of-]+")


def check_report(folder: RunFolder, parts: Sequence[RunPart]) -> tuple[list[str], list[str]]:
    """Compare every file of a report in the folder of a run with what would be written there.

    Videos are those that a page shows, and so are replays, as far as they are there. Beside a page
    of other software only numbers that both have are compared: headlines and cells of tables.

    Returns:
        What differs, one sentence a file, and the pages of other software.
    """
    there = {name: folder.file(name).read_text("utf-8", "replace") for name in folder.report()}
    others = [name for name in there if name.endswith(PAGE) and SOFTWARE not in there[name]]
    left, wrong = dict(there), []
    for name, text in report_files(folder, folder, parts, there) if there else ():
        is_other = re.sub(r"(figures/)?[^/]*$", PAGE, name) in others
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
        if claims.get(place) != facts.get(place):
            claim, fact = (_plain(each.get(place, "")) for each in (claims, facts))
            if claim == fact:
                return "differs in a figure, a style or a script from what its records give"
            return (
                f"says “{escaped(claim[:_LONGEST])}”, its records give “{escaped(fact[:_LONGEST])}”"
            )
    return ""


def _claims(name: str, text: str, is_other: bool) -> Mapping[Any, str]:
    """What a file says by where it says it: value by value, or line by line."""
    if name.endswith(".json"):
        with suppress(ValueError, RecursionError):
            document = json.loads(
                text,
                parse_float=lambda text: float(f"{float(text):.9g}"),  # as on any processor
                object_pairs_hook=lambda pairs: (
                    pairs if len(dict(pairs)) < len(pairs) else dict(pairs)
                ),
            )
            return dict(_leaves(document))
    if is_other:
        numbers = re.findall(r"\d[\d.]*", "" if name.endswith(".svg") else text)
        return dict(_cells(text) if name.endswith(".html") else enumerate(numbers))
    return dict(enumerate(text.splitlines()))


def _leaves(value: Any, place: str = "") -> Iterator[tuple[str, str]]:
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
    return " ".join(unescape(re.sub(r"<[^<>]*>", " ", text)).split())
