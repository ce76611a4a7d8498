"""`duobench real doctor`: whether a rig is fit."""

from __future__ import annotations

import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image as Pictures
from rich.text import Text

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import (
    CHECK_STYLES,
    counted,
    say,
    table,
)
from duobench.cli.shared.rigs import known_rig
from duobench.core.backend import Image
from duobench.core.errors import BackendError
from duobench.real.canonical import NATIVE
from duobench.real.clock import SystemClock, VirtualClock
from duobench.real.doctor.checks import Check, write_checks
from duobench.world.robot.cameras import HEAD

if TYPE_CHECKING:
    from duobench.real.duo import FrankaDuo


def run(
    rig: str,
    out: Path,
    seconds: float = 10.0,
    hold: bool = True,
    store_reference: bool = False,
) -> None:
    """Look at computer, arms, grippers and cameras of a rig; exit code 1 if a check fails.

    Arms hold where they are for a while, once you have said that they may. Not yet tried on an arm.

    Args:
        rig: The rig's file, rig.json, or rehearsal, a rig without hardware.
        out: Folder of the run, into which doctor.json is written.
        seconds: How long the arms hold, while cameras and commands are counted.
        hold: Let the arms hold; without it nothing is told about control commands.
        store_reference: Store the image of the head camera beside the rig's file: later, doctors
            compare with it whether the camera was moved. Clear the table and bring the arms home
            before.
    """
    if seconds <= 0.0:
        raise AdvisedError("--seconds is more than 0.")
    from duobench.real.catalog import REHEARSAL
    from duobench.real.doctor.examine import examine
    from duobench.real.opening import open_rig

    known = known_rig(rig)
    reference = None if rig == REHEARSAL else Path(rig).with_suffix(".head.png")
    if store_reference and reference is None:
        raise AdvisedError(
            f"The rig {rig} has no file beside which a reference could be kept."
        )
    # Without hardware, time is simulated too, so that the command does not wait.
    clock = VirtualClock() if known.is_computed else SystemClock()
    with closing(open_rig(known, clock, guard=False)) as duo:
        if hold:
            _ask(duo, is_simulated=known.is_computed)
        if store_reference and reference is not None:
            duo.start()
            Pictures.fromarray(duo.images([HEAD], NATIVE)[HEAD]).save(reference)
            say(f"Reference: {reference}")
        checks = examine(duo, seconds=seconds, reference=_read(reference))
    written = write_checks(out, duo.rig.name, duo.rig.hash, checks)
    _show(checks)
    say(f"Written to {written}")
    failed = sum(check.outcome == "failed" for check in checks)
    if failed:
        say(f"{counted(failed, 'check')} failed.", style="bold red")
        sys.exit(1)


def _ask(duo: FrankaDuo, *, is_simulated: bool) -> None:
    """Have the operator allow that the arms hold; errors of connecting are found again later."""
    try:
        duo.start()
    except BackendError:
        return
    if not is_simulated:
        say(
            "Both arms will be held where they are. Keep everyone out of reach, and a hand on the "
            "emergency stop. Press Enter to go on, or Ctrl-C to leave."
        )
        if not sys.stdin.readline():
            return
    duo.supervisor.confirm()


def _read(path: Path | None) -> Image | None:
    if path is None or not path.exists():
        return None
    with Pictures.open(path) as picture:
        return np.array(picture.convert("RGB"))


def _show(checks: tuple[Check, ...]) -> None:
    rows = table("Check", "", "Found")
    for check in checks:
        found = Text(check.value)
        if check.advice:
            found.append(f"\n{check.advice}", style="italic")
        rows.add_row(
            check.name, Text(check.outcome, style=CHECK_STYLES[check.outcome]), found
        )
    say(rows)
