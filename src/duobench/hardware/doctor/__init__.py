"""Whether a rig is fit for a session: computer, arms, grippers and cameras, each looked at."""

from duobench.hardware.doctor.checks import (
    DOCTOR_FILE,
    Check,
    Outcome,
    Report,
    is_well,
    read_checks,
    write_checks,
)
from duobench.hardware.doctor.examine import examine

__all__ = [
    "DOCTOR_FILE",
    "Check",
    "Outcome",
    "Report",
    "examine",
    "is_well",
    "read_checks",
    "write_checks",
]
