"""The rig that a command line names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from duobench.cli.shared.advice import AdvisedError

if TYPE_CHECKING:
    from duobench.hardware.duo import FrankaDuo


@dataclass(frozen=True, kw_only=True, slots=True)
class RigOptions:
    """The rig, and how it is driven."""

    rig: str
    """File of the rig, rig.json, or simulated for drivers without hardware."""
    guard: bool = True
    """Keep the arms apart and off the table by a simulation of them."""
    fast: bool = False
    """Do not wait for real time; for drivers without hardware alone."""

    def open(self) -> FrankaDuo:
        """The rig, not connected yet.

        Raises:
            AdvisedError: It is fast, and there is hardware; or there is no such file.
            FileError: The file cannot be read, or is no rig.
        """
        from duobench.data.rig import drivers_of
        from duobench.hardware.clock import VirtualClock
        from duobench.hardware.opening import SIMULATED, open_rig

        if self.rig != SIMULATED and not Path(self.rig).exists():
            raise AdvisedError(
                f"There is no file {self.rig}. --rig takes a rig.json, or {SIMULATED}."
            )
        duo = open_rig(self.rig, VirtualClock() if self.fast else None, guard=self.guard)
        if self.fast and set(drivers_of(duo.rig)) != {SIMULATED}:
            raise AdvisedError("Hardware has a clock of its own: leave out --fast.")
        return duo
