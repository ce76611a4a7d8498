"""The paper's results, beside which runs can be shown.

They were measured elsewhere, on the paper's own implementation of the tasks: nothing is tested
against them.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import msgspec

from duobench.errors import check_known

SCHEME = "paper:"
"""What the name of one of its policies begins with."""
WARNING = "measured elsewhere, on other tasks"
"""What stands beside each of its numbers."""

Value = tuple[float, float]
"""Success rate in percent and mean final progress."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Mean:
    """A mean over some tasks, named by their ids, as the paper gives it."""

    tasks: frozenset[str]
    values: dict[str, Value]


@dataclass(frozen=True, kw_only=True, slots=True)
class PaperResults:
    """The table of the results in simulation."""

    source: str
    rollouts: int
    policies: dict[str, str]
    """Names for people, by the name that follows `paper:`."""
    tasks: dict[str, dict[str, Value]]
    """By id of the task and by policy."""
    means: dict[str, Mean]
    """By category; `overall` is the one over all tasks."""


@cache
def paper_results() -> PaperResults:
    """The table, from the file beside this module."""
    text = files("duobench.results").joinpath("paper.toml").read_bytes()
    return msgspec.toml.decode(text, type=PaperResults)


def check_policy(source: str) -> str:
    """The name of a policy without `paper:`."""
    known = [f"{SCHEME}{name}" for name in paper_results().policies]
    check_known("policy of the paper", source, known)
    return source.removeprefix(SCHEME)


def value_of(policy: str, tasks: Collection[str]) -> Value | None:
    """What the paper reports for a policy on one task, or as the mean of exactly these tasks."""
    results: PaperResults = paper_results()
    if len(tasks) == 1:
        (task,) = tasks
        return results.tasks.get(task, {}).get(policy)
    wanted = frozenset(tasks)
    means = (mean.values[policy] for mean in results.means.values() if mean.tasks == wanted)
    return next(means, None)
