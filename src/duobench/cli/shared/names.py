"""Names of tasks, policies, suites and looks, checked before anything large is loaded."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from duobench.errors import PolicyError, check_known
from duobench.tasks import catalog

TRAINED = ("act", "diffusion", "pi05", "xvla")
"""Kinds of policies, which people take for the name of one."""
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
    verb, *rest = words or [""]
    kinds, option = NAMED.get(verb, {}), FIRST
    if "--follow" in rest:  # a run that may not be there yet
        return
    for word in rest:
        value = word
        if word.startswith("--"):
            option, _, value = word.partition("=")
        kind = kinds.get(option, "")
        if value:
            _check(kind, value)
            option = option if kind == "task" else "-"  # of tasks there may be several


def _check(kind: str, word: str) -> None:
    if kind == "task" and not Path(word).exists():  # which `view` shows
        catalog.check(word)
    elif kind == "policy" and word in TRAINED:
        raise PolicyError(f"A trained {word} is lerobot:PATH; duobench train {word} trains one.")
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
