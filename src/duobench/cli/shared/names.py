"""Names of tasks, policies, suites and looks, checked before anything large is loaded."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from duobench.errors import DuoBenchError, check_known
from duobench.tasks import catalog

ALL = "all"


class MisnamedError(DuoBenchError):
    """A name that stands for nothing, where a verb takes a name."""


def _task(word: str) -> None:
    catalog.check(word)


def _tasks(word: str) -> None:
    if word == ALL:
        raise MisnamedError("No task is named all: leave --tasks out, and all tasks are meant.")
    catalog.check(word)


def _printed(word: str) -> None:
    if word != ALL:
        catalog.check(word)


def _viewed(word: str) -> None:
    if not Path(word).exists():
        catalog.check(word)


def _policy(word: str) -> None:
    from duobench.policy.registry import PolicyName
    from duobench.policy.serving.address import WORDS

    PolicyName.parse(word, WORDS)


def _served(word: str) -> None:
    from duobench.policy.registry import PolicyName, reads_simulation

    if not reads_simulation(word):  # the verb says why that cannot be served
        PolicyName.parse(word)


def _suite(word: str) -> None:
    from duobench.results.suite import SUITES

    check_known("suite", word, SUITES)


def _look(word: str) -> None:
    from duobench.looks.catalog import look

    look(word)


def _shift(word: str) -> None:
    from duobench.shifts.shift import Shift

    Shift.parse(word)


Check = Callable[[str], None]
FIRST = ""
"""Stands for the first argument of a verb, where that is no option."""
NAMED: Mapping[str, Mapping[str, Check]] = {
    "eval": {
        "--tasks": _tasks,
        "--policy": _policy,
        "--suite": _suite,
        "--look": _look,
        "--shift": _shift,
    },
    "record": {"--tasks": _tasks, "--policy": _policy},
    "render": {FIRST: _task, "--look": _look},
    "view": {FIRST: _viewed, "--look": _look},
    "replay": {"--look": _look},
    "teleop": {FIRST: _task, "--look": _look},
    "print": {FIRST: _printed},
    "serve": {"--policy": _served},
}
"""What of the arguments of a verb are names, and what checks one."""


def check_names(words: Sequence[str]) -> None:
    """Reject the first name among the arguments that stands for nothing.

    Paths of modules are left to the verbs, which import them.

    Raises:
        DuoBenchError: There is no task, policy, suite, look or shift of a name.
    """
    verb, *rest = [*words, ""]
    checks = NAMED.get(verb, {})
    if "--follow" in rest:  # a run that may not be there yet
        return
    for option, word in _pairs(rest):
        if word and (check := checks.get(option)):
            check(word)


def _pairs(words: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Every word with the option that it follows; an option takes one or several."""
    option = FIRST
    for word in words:
        if word.startswith("--"):
            option, _, value = word.partition("=")
            yield option.replace("_", "-"), value
        else:
            yield option, word
