"""`duobench real doctor`: whether a rig is fit for a session."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import console

if TYPE_CHECKING:
    from duobench.backend import Image
    from duobench.hardware.doctor.checks import Check
    from duobench.hardware.duo import FrankaDuo

_STYLES = {"ok": "green", "note": "yellow", "failed": "bold red", "skipped": "dim"}


def doctor(
    rig: str,
    out: Path,
    seconds: float = 10.0,
    hold: bool = True,
    store_reference: bool = False,
) -> None:
    """Look at computer, arms, grippers and cameras of a rig; exit code 1 if a check fails.

    Arms hold where they are for a while, once you have said that they may. Not yet tried on an arm.

    Args:
        rig: The rig's file, or simulated.
        out: Folder of the run, into which doctor.json is written.
        seconds: How long the arms hold, while cameras and commands are counted.
        hold: Let the arms hold; without it nothing is told about control commands.
        store_reference: Store the image of the head camera beside the rig's file: later, doctors
            compare with it whether the camera was moved. Clear the table and bring the arms home
            before.
    """
    if seconds <= 0.0:
        raise AdvisedError("--seconds is more than 0.")
    from duobench.hardware.clock import SystemClock, VirtualClock
    from duobench.hardware.doctor.checks import write_checks
    from duobench.hardware.doctor.examine import examine
    from duobench.hardware.opening import SIMULATED, open_rig
    from duobench.hardware.rig import Rig

    if rig != SIMULATED and not Path(rig).is_file():
        raise AdvisedError(f"There is no file {rig}. --rig takes a rig.json, or {SIMULATED}.")
    reference = None if rig == SIMULATED else Path(rig).with_suffix(".head.png")
    if store_reference and reference is None:
        raise AdvisedError("The simulated rig has no file beside which a reference could be kept.")
    known = Rig.simulated() if rig == SIMULATED else Rig.read(Path(rig))
    # Where nothing is hardware, time is computed as well: nobody has to wait.
    duo = open_rig(known, VirtualClock() if known.is_computed else SystemClock(), guard=False)
    try:
        if hold:
            _ask(duo, is_simulated=known.is_computed)
        if store_reference and reference is not None:
            _store(duo, reference)
        checks = examine(duo, seconds=seconds, reference=_read(reference))
    finally:
        duo.close()
    path = write_checks(out, duo.rig.name, duo.rig.hash, checks)
    _show(checks)
    screen = console()
    screen.print(f"Written to {path}")
    failed = sum(check.outcome == "failed" for check in checks)
    if failed:
        noun = "check" if failed == 1 else "checks"
        screen.print(f"{failed} {noun} failed.", style="bold red")
        sys.exit(1)


def _ask(duo: FrankaDuo, *, is_simulated: bool) -> None:
    """Have the operator allow that the arms hold; errors of connecting are found again later."""
    from duobench.errors import BackendError

    try:
        duo.start()
    except BackendError:
        return
    if not is_simulated:
        console().print(
            "Both arms will be held where they are. Nobody within reach, a hand on the emergency "
            "stop. Press Enter to go on, or Ctrl-C to leave."
        )
        if not sys.stdin.readline():
            return
    duo.supervisor.confirm()


def _store(duo: FrankaDuo, path: Path) -> None:
    from PIL import Image as Pictures

    from duobench.hardware.canonical import NATIVE
    from duobench.types import HEAD

    duo.start()
    Pictures.fromarray(duo.images([HEAD], NATIVE)[HEAD]).save(path)
    console().print(f"Reference: {path}")


def _read(path: Path | None) -> Image | None:
    import numpy as np
    from PIL import Image as Pictures

    if path is None or not path.exists():
        return None
    with Pictures.open(path) as picture:
        return np.array(picture.convert("RGB"))


def _show(checks: tuple[Check, ...]) -> None:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in ("Check", "", "Found"):
        table.add_column(heading)
    for check in checks:
        found = Text(check.value)
        if check.advice:
            found.append(f"\n{check.advice}", style="italic")
        table.add_row(check.name, Text(check.outcome, style=_STYLES[check.outcome]), found)
    console().print(table)
