"""The record of one finished episode: everything that a table or a report is computed from.

A record holds no clock time and no name of a machine's folder, so that the same episode gives the
same bytes however it was run: with another number of workers, in another order, after a restart.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from duobench.errors import EvaluationError
from duobench.evaluation.files import write_text

RECORD_SCHEMA = 1
"""Version of the record's fields; raised when one is added, removed or changes its meaning."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeRecord:
    """One episode of one task, from its seed to its last stage."""

    suite_version: str
    """Version of the benchmark's episodes that the seed belongs to."""
    task: str
    """Id of the task."""
    episode: int
    """Index of the episode in the suite."""
    seed: int
    """Seed of the reset; a pure function of (task, suite version, episode)."""
    policy: str
    """Name under which the policy was asked for."""
    instruction: str
    """What the policy was told to do; empty if the episode died before its reset."""
    success: bool
    """Whether the last stage was reached."""
    success_at_end: bool
    """Whether the constraints of the last stage still held after the last step."""
    final_stage: int
    """Highest stage that was reached, 0 for none."""
    max_stage: int
    """The task's last stage."""
    stage_changes: tuple[tuple[int, int], ...]
    """Pairs (control step, stage): after how many steps each newly reached stage was reached."""
    steps: int
    """Control steps that were executed."""
    horizon: int
    """Control steps after which the task truncates an episode."""
    terminated: bool
    """Whether the environment ended the episode."""
    truncated: bool
    """Whether the horizon ended the episode."""
    error: str | None
    """Traceback of what broke the episode; such an episode counts as failed."""
    layout: dict[str, Any]
    """What the reset drew: poses and variants, as the task describes them."""
    fingerprint: str | None
    """SHA-256 of the full simulation state after the last step; None if the episode broke."""
    versions: dict[str, str | None]
    """Versions of everything that the result may depend on."""

    def __post_init__(self) -> None:
        """Refuse a record that contradicts itself."""
        reached = [stage for _, stage in self.stage_changes]
        when = [step for step, _ in self.stage_changes]
        problems = {
            "stage_changes must rise in step and stage": when != sorted(set(when))
            or reached != sorted(set(reached)),
            "final_stage must be the last stage of stage_changes": self.final_stage
            != (reached[-1] if reached else 0),
            "final_stage must lie in 0..max_stage": not 0 <= self.final_stage <= self.max_stage,
            "success must mean that the last stage was reached without an error": self.success
            != (self.final_stage == self.max_stage and self.error is None),
            "stages are reached within the executed steps": bool(when)
            and not 0 <= when[0] <= when[-1] <= self.steps,
            "no more steps than the horizon": self.steps > self.horizon,
        }
        broken = [rule for rule, violated in problems.items() if violated]
        if broken:
            raise EvaluationError(
                f"Record of {self.task}, episode {self.episode}: {'; '.join(broken)}."
            )

    @property
    def progress(self) -> float:
        """Highest stage over last stage, 0..1."""
        return self.final_stage / self.max_stage

    def stage_after(self, step: int) -> int:
        """Stage after that many control steps; the last one stays once the episode is over."""
        return max((stage for when, stage in self.stage_changes if when <= step), default=0)

    def to_json(self) -> str:
        """As JSON text, one field a line; the same record always gives the same text."""
        document = {"schema": RECORD_SCHEMA, **asdict(self)}
        lines = [
            f'  "{key}": {json.dumps(value, ensure_ascii=False, allow_nan=False)}'
            for key, value in document.items()
        ]
        return "{\n" + ",\n".join(lines) + "\n}\n"

    @staticmethod
    def from_json(text: str) -> EpisodeRecord:
        """From the text that `to_json` gave.

        Raises:
            EvaluationError: If it is no JSON, another schema, or a field is missing or unknown.
        """
        try:
            document = json.loads(text)
        except ValueError as error:
            raise EvaluationError(f"No JSON: {error}.") from error
        if not isinstance(document, dict):
            raise EvaluationError(f"A record is a JSON object, not a {type(document).__name__}.")
        schema = document.pop("schema", None)
        if schema != RECORD_SCHEMA:
            raise EvaluationError(f"Schema {schema!r}; this version reads {RECORD_SCHEMA}.")
        _check_fields(document)
        document["stage_changes"] = tuple(
            (int(step), int(stage)) for step, stage in document["stage_changes"]
        )
        return EpisodeRecord(**document)


def _check_fields(document: Mapping[str, Any]) -> None:
    """Compare the fields of a parsed record with those that there should be."""
    expected = {field.name for field in fields(EpisodeRecord)}
    if missing := sorted(expected - document.keys()):
        raise EvaluationError(f"Missing fields: {', '.join(missing)}.")
    if unknown := sorted(document.keys() - expected):
        raise EvaluationError(f"Unknown fields: {', '.join(unknown)}.")


def write_record(path: Path, record: EpisodeRecord) -> None:
    """Write a record in one atomic step."""
    write_text(path, record.to_json())


def read_record(path: Path) -> EpisodeRecord:
    """Read a record.

    Raises:
        EvaluationError: If the file holds none; the message says which file, and how to go on.
    """
    try:
        return EpisodeRecord.from_json(path.read_text(encoding="utf-8"))
    except (EvaluationError, UnicodeDecodeError, TypeError, ValueError) as error:
        raise EvaluationError(
            f"Cannot read the record {path}: {error} Delete the file and run the evaluation again: "
            "it runs only the missing episodes."
        ) from error
