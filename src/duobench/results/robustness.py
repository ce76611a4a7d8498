"""Robustness of policies under shifts: one page, its figure, and a JSON file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from duobench.core.errors import EvaluationError
from duobench.results import figures
from duobench.results.pages import (
    PAGE,
    check_free,
    json_text,
    page,
    with_figures,
    write_files,
)
from duobench.results.scores import RunPart, Score
from duobench.tasks.shifts import shift as shifts

DOCUMENT = "robustness.json"
"""The results for programs; a folder that has it holds a report."""
ROBUSTNESS_SCHEMA = 2
BOUNDED = (shifts.LAYOUT, shifts.PHYSICS, shifts.LATENCY)
"""Axes whose levels scripted experts still solve."""
UNPROVEN = (shifts.LOOK, shifts.CAMERA, shifts.SENSING)
"""Axes that change only what a policy sees, of which its joint targets prove nothing."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Robustness:
    """Results of a policy under shifts."""

    title: str
    """Name of the policy, or the one that was given."""
    parts: tuple[RunPart, ...]
    """Played parts, shift by shift."""

    @property
    def first(self) -> RunPart:
        """One of them, for what all have in common."""
        return self.parts[0]

    @property
    def axes(self) -> list[str]:
        """The axes that were played."""
        played = {part.condition.shift.axis for part in self.parts}
        return [axis for axis in shifts.EVERY_AXIS if axis in played]

    @property
    def missing(self) -> int:
        """Episodes that have no record."""
        return sum(part.size - part.results.overall.episodes for part in self.parts)

    def at(self, axis: str, level: int) -> RunPart | None:
        """Part along an axis at a level from 0 to 5; None if it was not played."""
        shift = shifts.Shift(axis=axis, level=level) if level else shifts.NO_SHIFT
        found = (part for part in self.parts if part.condition.shift == shift)
        return next((part for part in found if part.results.overall.episodes), None)

    def levels(self, axis: str) -> dict[int, Score]:
        """Scores at the levels of an axis that were played, 0 included."""
        each = {level: self.at(axis, level) for level in range(shifts.LEVELS + 1)}
        return {level: part.results.overall for level, part in each.items() if part}


def robustness_of(parts: Sequence[RunPart], title: str = "") -> list[Robustness]:
    """Results of each policy of a run under shifts; a run of one may give it another title."""
    if all(part.condition.shift == shifts.NO_SHIFT for part in parts):
        raise EvaluationError("Nothing was played under a shift.")
    by_policy: dict[str, list[RunPart]] = {}
    for part in parts:
        by_policy.setdefault(part.candidate.title, []).append(part)
    return [
        Robustness(
            title=title if title and len(by_policy) == 1 else name, parts=tuple(ours)
        )
        for name, ours in by_policy.items()
    ]


def write_robustness(policies: Sequence[Robustness], out: Path) -> Path:
    """Write page, figure and JSON form of what policies, laid over each other, reached."""
    check_free(out, DOCUMENT, "evaluation under shifts")
    return write_files(out, robustness_files(policies))


def robustness_files(policies: Sequence[Robustness], pages: str = "") -> dict[str, str]:
    """The same files as text by name, with links to a folder of pages of each condition, if any."""
    axes = [
        axis for axis in shifts.EVERY_AXIS if any(axis in one.axes for one in policies)
    ]
    runs = [
        (one.title, {axis: one.levels(axis) for axis in one.axes}) for one in policies
    ]
    svgs = {"levels": figures.as_svg("levels", figures.levels, axes, runs)}
    text = page(
        "robustness.html.j2",
        svgs,
        policies=policies,
        axes=axes,
        levels=range(shifts.LEVELS + 1),
        pages=pages,
        bounded=BOUNDED,
        unproven=UNPROVEN,
        all_axes=shifts.ALL_AXES,
    )
    return with_figures({DOCUMENT: _document(policies), PAGE: text}, svgs)


def _document(policies: Sequence[Robustness]) -> str:
    content = {
        "schema": ROBUSTNESS_SCHEMA,
        "policies": [
            {
                "name": one.title,
                **one.first.facts("policy", "policy_version", "privileged"),
                **one.first.facts("suite", "suite_version"),
                "missing_episodes": one.missing,
                "conditions": {
                    part.condition.shift.name: part.results.overall.numbers()
                    for part in one.parts
                },
            }
            for one in policies
        ],
    }
    return json_text(content)
