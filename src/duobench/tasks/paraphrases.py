"""The instructions of the benchmark's tasks in other words: the sentences of `paraphrases.toml`."""

import tomllib
from functools import cache
from importlib.resources import files

_Sentences = dict[str, list[str]]


def paraphrases(task_id: str) -> tuple[str, ...]:
    """Instructions that demonstrations of a task may have in place of its own."""
    return tuple(_sentences()[task_id]["varied"])


def kept_paraphrases(task_id: str) -> tuple[str, ...]:
    """Instructions that no demonstration of a task has."""
    return tuple(_sentences()[task_id]["kept"])


@cache
def _sentences() -> dict[str, _Sentences]:
    return tomllib.loads(
        files("duobench.tasks").joinpath("paraphrases.toml").read_text("utf-8")
    )
