"""`duobench real calibrate gripper`: where a gripper is open and closed."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Literal

import tyro

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import say
from duobench.cli.shared.rigs import rig_file
from duobench.core.types import Side
from duobench.real.clock import SystemClock
from duobench.real.rig import Rig


def run(side: tyro.conf.Positional[Literal["left", "right"]], rig: Path) -> None:
    """Measure at which positions a gripper is open and closed, empty; its fingers move.

    Args:
        side: Whose gripper.
        rig: The rig's file, into which the positions are written.
    """
    from duobench.real.catalog import load_driver

    known, arm = Rig.read(rig_file(rig)), Side(side)
    config = known.grippers[arm]
    driver = load_driver("grippers", config.driver)
    if hasattr(driver, "knows_ends"):
        say(f"Nothing is measured for the {side} gripper: {driver.knows_ends}.")
        return
    if not hasattr(driver, "measure_ends"):
        raise AdvisedError(
            f"The {side} gripper of this rig has no positions to measure."
        )
    say(
        f"The {side} gripper will open and close, with nothing between its fingers. Press Enter to "
        "go on, or Ctrl-C to leave."
    )
    if not sys.stdin.readline():
        raise AdvisedError("It was not confirmed that the gripper may move.")
    found = driver.measure_ends(config, SystemClock())
    replace(known, grippers={**known.grippers, arm: found}).write(rig)
    say(
        f"Open at {found.open_count}, closed at {found.closed_count}; written to {rig}."
    )
