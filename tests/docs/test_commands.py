"""Commands and options that pages name exist."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from duobench.cli.program import COMMANDS, function_of
from duobench.cli.shared.options import options_of
from tests.docs.markdown import PAGES, page_of, text_of


def commands() -> Iterator[tuple[str, str]]:
    """Every command that a page shows on a line of its own, and the page."""
    for page in PAGES:
        for line in text_of(page).replace("\\\n", " ").splitlines():
            if line.startswith("duobench "):
                yield page.name, line


def found(words: Sequence[str]) -> Callable[..., None]:
    (name,) = (name for name in COMMANDS if words[: len(name.split())] == name.split())
    return function_of(name)


def flags(verb: Callable[..., None]) -> set[str]:
    return {each.flag for each in options_of(verb) if "Positional" not in str(each.kind)}


@pytest.mark.parametrize(("page", "line"), sorted(set(commands())))
def test_every_command_of_a_page_has_a_verb_and_options_that_exist(page: str, line: str) -> None:
    del page
    words = shlex.split(line, comments=True)[1:]
    own = words[: words.index("--")] if "--" in words else words
    named = {word.partition("=")[0] for word in own if word.startswith("--")}
    assert named <= flags(found(words))


@pytest.mark.parametrize(
    "page",
    [page_of(name) for name in ("commands", "evaluation", "policies")],
    ids=Path.__str__,
)
def test_options_that_sentences_name_exist(page: Path) -> None:
    verbs = ("eval", "record", "replay", "report", "train", "view")
    known = {flag for verb in verbs for flag in flags(function_of(verb))}
    named = set(re.findall(r"`(--[a-z-]+)", text_of(page)))
    assert named
    assert named <= known
