"""The report of a suite that was played under shifts: one page, its figure, and a JSON file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from markupsafe import Markup

from duobench.errors import OtherRunError
from duobench.files import make_folder, write
from duobench.pages import render
from duobench.results import metrics
from duobench.results.figures import as_svg, for_page
from duobench.results.metrics import Score
from duobench.results.robustness.conditions import Robustness, conditions_in
from duobench.results.robustness.figure import levels_figure
from duobench.results.suites.catalog import execute_text, latency_text, suite_text
from duobench.shifts.shift import ALL_AXES, AXES, LATENCY, LAYOUT, LEVELS, PHYSICS

DOCUMENT = "robustness.json"
"""The results for programs; a folder that has it holds a report."""
PAGE = "index.html"
"""The report for people."""
ROBUSTNESS_SCHEMA = 1
"""Version of the document's fields."""
BOUNDED = (LAYOUT, PHYSICS, LATENCY)
"""Axes whose levels scripted experts still solve."""


def write_robustness(policies: Sequence[Robustness], out: Path) -> Path:
    """Write page, figure and JSON form of what policies reached under shifts.

    Args:
        policies: One, or several to be laid over each other.
        out: Folder, which is made; that of the conditions themselves, or one for a comparison.

    Returns:
        The page.

    Raises:
        OtherRunError: The folder holds something else.
        OutputError: It cannot be written.
    """
    ours = set(conditions_in(out).values())
    there = set(out.iterdir()) if out.is_dir() else set()
    if there - ours and not (out / DOCUMENT).exists():
        raise OtherRunError(f"{out} is not empty and holds no evaluation under shifts.")
    make_folder(out)
    svg = as_svg("levels", partial(levels_figure, policies))
    write(out / DOCUMENT, document(policies))
    write(out / "figures" / "levels.svg", svg)
    write(out / PAGE, _page(policies, svg, is_beside=bool(ours)))
    return out / PAGE


def document(policies: Sequence[Robustness]) -> str:
    """The results as JSON text."""
    content = {
        "schema": ROBUSTNESS_SCHEMA,
        "policies": [
            {
                "name": one.title,
                "policy": one.run.policy,
                "policy_version": one.run.metadata.version,
                "privileged": one.run.privileged,
                "suite": one.run.suite.label,
                "suite_version": one.run.suite.version,
                "missing_episodes": one.missing,
                "conditions": {
                    shift.name: _numbers(found.results.overall)
                    for shift, found in one.conditions.items()
                },
            }
            for one in policies
        ],
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _numbers(score: Score) -> dict[str, Any]:
    return {
        "episodes": score.episodes,
        "successes": score.successes,
        "success_rate": score.success_rate,
        "wilson_95": list(score.interval),
        "mean_final_progress": score.mean_final_progress,
    }


def _page(policies: Sequence[Robustness], svg: str, *, is_beside: bool) -> str:
    return render(
        "duobench.results",
        "robustness.html.j2",
        policies=policies,
        axes=[axis for axis in AXES if any(axis in one.axes for one in policies)],
        levels=range(LEVELS + 1),
        svg=Markup(for_page(svg)),
        is_beside=is_beside,
        bounded=BOUNDED,
        all_axes=ALL_AXES,
        metrics=metrics,
        suite_text=suite_text,
        execute_text=execute_text,
        latency_text=latency_text,
    )
