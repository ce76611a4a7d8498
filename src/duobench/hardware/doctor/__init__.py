"""Whether a rig is fit for a session: computer, arms, grippers and cameras, each looked at."""

from duobench.hardware.doctor.checks import Check, Outcome, is_well, write_checks
from duobench.hardware.doctor.examine import examine

__all__ = ["Check", "Outcome", "examine", "is_well", "write_checks"]
