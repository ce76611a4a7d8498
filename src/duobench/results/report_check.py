"""Whether what people read in the folder of a run is what its records give."""

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
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
_CELL = re.compile(r"<(?:dd|td)\b[^<>]*>(?:\s*<(?!/)[^<>]*>)*\s*(\d[\d.–% ]*)")


def check_report(folder: RunFolder, parts: Sequence[RunPart]) -> tuple[list[str], list[str]]:
    """Compare every file of a report in the folder of a run with what would be written there.

    Videos are those that a page shows, and so are replays, as far as they are there. A page of
    other software, or of a run without journals, needs only to have the numbers that the records
    give, and so does what lies beside it.

    Returns:
        What differs, one sentence a file, and the pages of which numbers alone are compared.
    """
    left = {name: folder.file(name).read_text("utf-8", "replace") for name in folder.report()}
    pages = {name: text for name, text in left.items() if name.endswith(PAGE)}
    is_known = bool(folder.writers)  # without journals its times and commands are not
    others = [name for name, text in pages.items() if not (is_known and software() in text)]
    wrong: list[str] = []
    for name, text in report_files(folder, folder, parts, pages) if left else ():
        is_other = re.sub(r"(figures/)?[^/]+$", PAGE, name) in others
        if name in left and (words := _difference(name, left.pop(name), text, is_other)):
            wrong.append(f"{name} {words}; duobench report writes it anew.")
    return wrong + [f"{name} is no part of this run's report; remove it." for name in left], others


def _difference(name: str, said: str, given: str, is_other: bool) -> str:
    """In what a file differs first, in words; empty for nothing."""
    claims, facts = (Counter(_claims(name, text, is_other)) for text in (said, given))
    lacking, added = (list(left) for left in (facts - claims, claims - facts))
    if lacking or (added and not is_other):
        first = ((each or ["nothing"])[0] for each in (added, lacking))
        claim, fact = (escaped(" ".join(text[:_LONGEST].split())) for text in first)
        return f"says “{claim}”, its records give “{fact}”"
    if is_other or name.endswith(".json") or said.splitlines() == given.splitlines():
        return ""
    return "differs in a figure, a style, a script or an order from what its records give"


def _claims(name: str, text: str, is_other: bool) -> list[str]:
    """What a file says: value by value, line by line, or in numbers alone."""
    if name.endswith(".json"):
        with suppress(ValueError, RecursionError):
            return [*_leaves(json.loads(text, parse_float=_number, object_pairs_hook=tuple))]
    if is_other and name.endswith(".html"):
        return [cell.strip() for cell in _CELL.findall(text)]
    if is_other:
        return [] if name.endswith(".svg") else re.findall(r"\d[\d.]*", text)
    return [line for line in unescape(_TAG.sub(" ", text)).splitlines() if line.strip()]


def _number(text: str) -> float:
    return float(f"{float(text):.9g}")  # the last bits of a logarithm are a processor's own


def _leaves(
    value: list[Any] | tuple[tuple[str, Any], ...] | float | str | None, place: str = ""
) -> Iterator[str]:
    if isinstance(value, list | tuple) and value:
        for name, part in value if isinstance(value, tuple) else enumerate(value):
            yield from _leaves(part, f"{place}{name} ")
    else:
        yield f"{place}{json.dumps(value, ensure_ascii=False)}"
