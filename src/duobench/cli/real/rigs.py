"""The rig that a command line names."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from duobench.cli.shared.advice import AdvisedError

if TYPE_CHECKING:
    from duobench.hardware.duo import FrankaDuo


def opened_rig(rig: str, *, guard: bool = True, fast: bool = False) -> FrankaDuo:
    """A rig, not connected yet.

    Args:
        rig: Its file, or "simulated".
        guard: Whether a simulation keeps the arms apart.
        fast: Whether its clock does not wait, as only drivers without hardware may have it.

    Raises:
        AdvisedError: It is fast, and there is hardware; or there is no such file.
        FileError: The file cannot be read, or is no rig.
    """
    from duobench.data.rig import drivers_of
    from duobench.hardware.clock import VirtualClock
    from duobench.hardware.opening import SIMULATED, open_rig

    if rig != SIMULATED and not Path(rig).exists():
        raise AdvisedError(f"There is no file {rig}. --rig takes a rig.json, or {SIMULATED}.")
    duo = open_rig(rig, VirtualClock() if fast else None, guard=guard)
    if fast and set(drivers_of(duo.rig)) != {SIMULATED}:
        raise AdvisedError("Hardware has a clock of its own: leave out --fast.")
    return duo
