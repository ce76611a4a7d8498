"""A comparison as JSON, for programs."""

from __future__ import annotations

import json
from typing import Any

from duobench.results.comparison.comparison import Comparison
from duobench.results.comparison.entrants import Cell, Entrant
from duobench.results.comparison.pairs import Pair, Test
from duobench.results.comparison.rows import Row
from duobench.results.comparison.words import caution, verdict
from duobench.results.statistics import LEVEL

COMPARISON_SCHEMA = 1
"""Version of the fields."""


def document(comparison: Comparison) -> str:
    """The comparison as JSON text, numbers with six digits."""
    content = {
        "schema": COMPARISON_SCHEMA,
        "level": round(LEVEL, 6),
        "policies": {one.key: _entrant(one) for one in comparison.entrants},
        "rows": [
            {
                **_row(row),
                "results": {
                    one.key: _cell(cell, comparison.is_best(row, one))
                    for one in comparison.entrants
                    if (cell := one.cell(row.tasks))
                },
            }
            for row in comparison.rows
        ],
        "pairs": [_pair(pair) for pair in comparison.pairs],
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _entrant(one: Entrant) -> dict[str, Any]:
    facts: dict[str, Any] = {"name": one.name, "group": one.group.value}
    if run := one.run:
        facts |= {
            "policy": run.policy,
            "policy_version": run.metadata.version,
            "privileged": run.privileged,
            "domain": run.domain,
            "trained_on": run.trained_on,
            "suite_version": run.suite.version,
            "look": run.suite.look,
            "first_episode": run.suite.first_episode,
            "expected_episodes": run.size,
            "suite": run.suite.label,
            "execute": run.suite.execution.execute,
            "latency": run.suite.execution.latency,
            "versions": run.versions,
        }
    return facts


def _row(row: Row) -> dict[str, Any]:
    return {"kind": row.kind.value, "label": row.label, "tasks": [task.id for task in row.tasks]}


def _cell(cell: Cell, is_best: bool) -> dict[str, Any]:
    return {
        "episodes": cell.episodes,
        "successes": cell.successes,
        "success_rate": _short(cell.rate),
        "wilson_95": cell.interval and [_short(end) for end in cell.interval],
        "mean_final_progress": _short(cell.progress),
        "best_of_group": is_best,
    }


def _pair(pair: Pair) -> dict[str, Any]:
    return {
        "a": pair.a.key,
        "b": pair.b.key,
        "paired": pair.paired,
        "crosses_groups": pair.crosses_groups,
        "not_tested_because": pair.obstacle,
        "episodes_left_out": pair.left_out,
        "verdict": verdict(pair),
        "caution": caution(pair),
        "tests": [_test(test, pair.paired) for test in pair.tests],
    }


def _test(test: Test, paired: bool) -> dict[str, Any]:
    return {
        **_row(test.row),
        "test": "McNemar, exact" if paired else "Barnard",
        "episodes": list(test.episodes),
        "successes": list(test.successes),
        "only_one_solved": test.only and list(test.only),
        "difference": _short(test.difference),
        "interval_95": [_short(end) for end in test.interval],
        "interval": "Tango" if paired else "Newcombe",
        "cohen_h": _short(test.effect),
        "p": _short(test.p),
        "p_holm": _short(test.adjusted),
        "progress_difference": _short(test.progress),
        "progress_p": _short(test.progress_p),
        "progress_p_holm": _short(test.progress_adjusted),
        "better": {1: "a", -1: "b", 0: None}[test.better],
        "more_episodes": test.more_episodes,
    }


def _short(value: float) -> float:
    return float(f"{value:.6g}")
