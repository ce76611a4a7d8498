"""A leaderboard as JSON, for programs."""

from __future__ import annotations

import json
from typing import Any

from duobench.results.leaderboard.board import Board, Entry
from duobench.results.metrics import Score

SCHEMA = 1
"""Version of the fields."""


def document(board: Board) -> str:
    """The leaderboard as JSON text, numbers with six digits."""
    content = {
        "schema": SCHEMA,
        **{
            name: [
                {"rank": one.rank, **_entry(one.entry)}
                for one in board.ranked(privileged=privileged)
            ]
            for name, privileged in (("ranked", False), ("ranked_privileged", True))
        },
        "not_ranked": [{**_entry(entry), "because": list(entry.lacks)} for entry in board.partial],
        "refused": [{"file": one.file, "reason": one.reason} for one in board.refused],
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _entry(entry: Entry) -> dict[str, Any]:
    return {
        "policy": entry.name,
        "policy_version": entry.run.metadata.version,
        "privileged": entry.privileged,
        "suite_version": entry.run.suite.version,
        "file": entry.file,
        "sha256": entry.digest,
        "verdicts": dict(entry.verdicts),
        "overall": _score(entry.results.overall),
        "categories": {one.label: _score(one) for one in entry.results.categories},
        "tasks": {one.task.id: _score(one.score) for one in entry.results.tasks},
    }


def _score(score: Score) -> dict[str, Any]:
    return {
        "episodes": score.episodes,
        "successes": score.successes,
        "success_rate": _short(score.success_rate),
        "wilson_95": [_short(end) for end in score.interval],
        "mean_final_progress": _short(score.mean_final_progress),
        "errors": score.errors,
    }


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.6g}")
