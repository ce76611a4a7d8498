"""The instructions of the benchmark's tasks in other words: the sentences of `paraphrases.toml`."""

import tomllib
from functools import cache
from importlib.resources import files

_Sentences = dict[str, list[str]]


def paraphrases(task_id: str) -> tuple[str, ...]:
    """What demonstrations of a task may say in place of its instruction."""
    return tuple(_sentences()[task_id]["varied"])


def kept_paraphrases(task_id: str) -> tuple[str, ...]:
    """What no demonstration of a task says."""
    return tuple(_sentences()[task_id]["kept"])


@cache
def _sentences() -> dict[str, _Sentences]:
    return tomllib.loads(
        files("duobench.tasks").joinpath("paraphrases.toml").read_text("utf-8")
    )
