"""Results of checks, and the file that keeps them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path

from duobench.core import files

DOCTOR_SCHEMA = 1
"""Version of the file; raised when a field changes its meaning."""
DOCTOR_FILE = "doctor.json"
"""Name of the file in a run's folder."""


class CheckOutcome(StrEnum):
    """Outcome of a check."""

    OK = "ok"
    NOTE = "note"
    """Worth knowing, and no reason to stop."""
    SKIPPED = "skipped"
    """Check that does not apply, or could not be made."""
    FAILED = "failed"

    def of(
        self,
        name: str,
        value: str,
        advice: str = "",
    ) -> Check:
        """A check that ended like this."""
        return Check(
            name=name,
            outcome=self,
            value=value,
            advice=advice,
        )

    def unless(
        self,
        is_well: bool,
        name: str,
        value: str,
        advice: str = "",
    ) -> Check:
        """A check that went well, or ended like this with a piece of advice."""
        return (
            CheckOutcome.OK.of(name, value) if is_well else self.of(name, value, advice)
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Check:
    """Check of one thing."""

    name: str
    outcome: CheckOutcome
    value: str
    """Finding in words and numbers."""
    advice: str = ""
    """Advice for the operator; empty where nothing is to be done."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Report:
    """All checks of a rig at one time."""

    rig: str
    rig_hash: str
    time: str
    """Time at which they ended, in UTC."""
    is_well: bool
    checks: tuple[Check, ...]

    def objection(self, rig_hash: str) -> str:
        """Reason why it does not clear a rig; empty if all is well."""
        if self.rig_hash != rig_hash:
            return f"looked at another rig, or at an earlier state of its file ({self.rig})"
        failed = [
            check.name for check in self.checks if check.outcome is CheckOutcome.FAILED
        ]
        return f"found what fails: {', '.join(failed)}" if failed else ""


def read_checks(folder: Path) -> Report | None:
    """Read `doctor.json` of a run's folder; None if it is missing."""
    path = folder / DOCTOR_FILE
    return files.read(path, Report, DOCTOR_SCHEMA) if path.exists() else None


def is_well(checks: Iterable[Check]) -> bool:
    """Whether no check failed."""
    return all(check.outcome is not CheckOutcome.FAILED for check in checks)


def write_checks(
    folder: Path, rig: str, rig_hash: str, checks: Sequence[Check]
) -> Path:
    """Write `doctor.json` into a run's folder, which is made if it is missing; gives the file."""
    report = Report(
        rig=rig,
        rig_hash=rig_hash,
        time=datetime.now(UTC).isoformat(timespec="seconds"),
        is_well=is_well(checks),
        checks=tuple(checks),
    )
    path = folder / DOCTOR_FILE
    files.write(path, files.encode(report, DOCTOR_SCHEMA))
    return path
