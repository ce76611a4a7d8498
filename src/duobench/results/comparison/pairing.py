"""Which episodes of two runs are the same, and whether two runs can be compared at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from duobench.looks.look import Look
from duobench.results.comparison.entrants import Entrant
from duobench.results.records import EpisodeRecord, SampledLayout
from duobench.results.run import Run
from duobench.results.suite import TaskInfo

Pairs = list[tuple[EpisodeRecord, EpisodeRecord]]

_DIGITS = 6
"""Layouts are compared in micrometres: another processor may have another last bit."""
_CONDITIONS = ("look", "horizon", "instructions", "split", "speed_fraction", "control_rate_hz")
"""What of a configuration is not the policy's choice."""


def obstacle(a: Run, b: Run) -> str | None:
    """Why two runs cannot be compared; None if they can."""
    if a.suite.version != b.suite.version:
        return (
            f"They played different suites ({a.suite.version} and {b.suite.version}), whose scores "
            "cannot be compared."
        )
    return None


def common_tasks(a: Entrant, b: Entrant) -> tuple[TaskInfo, ...]:
    """Tasks of which both have finished episodes, with the same stages and the same horizon."""
    theirs = {one.task.id: one.task for one in b.results.tasks} if b.results else {}
    ours = [one.task for one in a.results.tasks] if a.results else []
    return tuple(
        task
        for task in ours
        if a.records(task.id)
        and b.records(task.id)
        and (task.stages, task.horizon) == (theirs[task.id].stages, theirs[task.id].horizon)
    )


def same_episodes(a: Sequence[EpisodeRecord], b: Sequence[EpisodeRecord]) -> Pairs:
    """The episodes of a task that both runs played, in pairs.

    Episodes are the same if suite version, task, split and seed are, which decide the layout, and
    if the layouts are, where both records have one. Looks, cameras and action modes may differ:
    they are part of what is compared.
    """
    theirs = {_identity(record): record for record in b}
    pairs = [(record, theirs[key]) for record in a if (key := _identity(record)) in theirs]
    return [(one, other) for one, other in pairs if _same_layout(one.layout, other.layout)]


def differing_conditions(a: Run, b: Run) -> list[str]:
    """What was not the same around the two policies, one phrase each."""
    return [
        f"{name.replace('_', ' ')} {_named(ours)} and {_named(theirs)}"
        for name in _CONDITIONS
        if (ours := getattr(a.config, name)) != (theirs := getattr(b.config, name))
    ]


def _named(value: object) -> str:
    return "one of its own" if isinstance(value, Look) else str(value)


def _identity(record: EpisodeRecord) -> tuple[str, str, str, int]:
    return record.suite_version, record.task, record.config.split, record.seed


def _same_layout(one: SampledLayout, other: SampledLayout) -> bool:
    return not (one and other) or _rounded(one) == _rounded(other)


def _rounded(layout: Mapping[str, object]) -> object:
    """A layout, its numbers rounded."""
    return {name: _round(value) for name, value in layout.items()}


def _round(value: object) -> object:
    match value:
        case dict():
            return {name: _round(part) for name, part in value.items()}
        case list() | tuple():
            return [_round(part) for part in value]
        case float():
            return round(value, _DIGITS) + 0.0
    return value
