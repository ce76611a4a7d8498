"""Names of tasks, policies, suites and looks, checked before anything large is loaded."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from duobench.errors import check_known
from duobench.tasks import catalog

FIRST = ""
"""Stands for the first argument of a verb, where that is no option."""
_OF_SCENE = {FIRST: "task", "--look": "look"}
NAMED: Mapping[str, Mapping[str, str]] = {
    "eval": {"--tasks": "task", "--policy": "policy", "--suite": "suite", "--look": "look"},
    "record": {"--tasks": "task", "--policy": "policy"},
    **dict.fromkeys(("render", "teleop", "view"), _OF_SCENE),
    "replay": {"--look": "look"},
    "serve": {"--policy": "policy"},
}
"""Which arguments of a verb are names, and of what."""


def check_names(words: Sequence[str]) -> None:
    """Reject the first name among the arguments that stands for nothing.

    Paths of modules are left to the verbs, which import them.

    Raises:
        DuoBenchError: There is no task, policy, suite or look of a name.
    """
    verb, *rest = [*words, ""]
    kinds = NAMED.get(verb, {})
    if "--follow" in rest:  # a run that may not be there yet
        return
    for option, word in _pairs(rest):
        if word and option in kinds:
            _check(kinds[option], word)


def _pairs(words: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Every word with the option that it follows; an option takes one or several."""
    option = FIRST
    for word in words:
        if word.startswith("--"):
            option, _, value = word.partition("=")
            yield option.replace("_", "-"), value
        else:
            yield option, word


def _check(kind: str, word: str) -> None:
    if kind == "task" and not Path(word).exists():  # which `view` shows
        catalog.check(word)
    elif kind == "policy":
        from duobench.policy.registry import PolicyName
        from duobench.policy.serving.address import WORDS

        PolicyName.parse(word, WORDS)
    elif kind == "suite":
        from duobench.results.suite import SUITES

        check_known(kind, word, SUITES)
    elif kind == "look":
        from duobench.looks.catalog import look

        look(word)
