"""`duobench doctor` and `duobench real doctor`: whether a machine and a rig are fit."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from statistics import median
from timeit import repeat
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image as Pictures
from rich.text import Text

from duobench.backend import Image
from duobench.cli.real.rigs import known_rig
from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import counted, say, table
from duobench.cli.shared.process import load_engine
from duobench.envs.config import IMAGE_SIZE
from duobench.errors import BackendError, DuoBenchError
from duobench.hardware.canonical import NATIVE
from duobench.hardware.clock import SystemClock, VirtualClock
from duobench.machine import unsupported
from duobench.randomness import SUITE_VERSION
from duobench.tasks import catalog
from duobench.types import HEAD, POLICY_CAMERAS
from duobench.versions import other_engine, record_versions

if TYPE_CHECKING:
    from duobench.hardware.doctor.checks import Check
    from duobench.hardware.duo import FrankaDuo


FIRST_COMMAND = "duobench eval --policy expert --tasks bin_sort --episodes 1 --out runs/first"
FRAMES = 20
"""Images that are timed; their median is shown."""


def doctor() -> None:
    """Show versions and graphics, with the time of an image; exit code 1 if one fails."""
    if problem := unsupported():
        say(problem, style="red")
        sys.exit(1)
    is_well = True
    for heading, look in (("Versions", _versions), ("Graphics", _graphics)):
        say(heading, style="bold")
        try:
            for name, value in look().items():
                say(f"  {name:<16}{value}")
        except DuoBenchError as error:
            is_well = False
            say(f"  does not work: {error}", style="red")
    if not is_well:
        sys.exit(1)
    say(f"All is well. Next: {FIRST_COMMAND}", style="bold")


def _versions() -> dict[str, str]:
    versions = {name: version for name, version in record_versions(None).items() if version}
    if other := other_engine(versions):
        versions["mujoco"] += f": {other}; runs with it are marked and not ranked"
    return {**versions, "suite version": SUITE_VERSION}


def _graphics() -> dict[str, str]:
    load_engine()
    from duobench.envs.sim_env import SimEnv
    from duobench.sim.rendering import Renderer

    base = SimEnv(catalog.get(catalog.names()[0]))
    base.reset()
    data = base.simulation.data
    height, width = IMAGE_SIZE
    with Renderer(base.simulation.model, height=height, width=width) as renderer:
        info = renderer.info
        one = _milliseconds(lambda: renderer.render(data, HEAD))
        three = _milliseconds(lambda: renderer.render_all(data, POLICY_CAMERAS))
    return {
        "backend": info.backend,
        "renderer": info.renderer,
        "vendor": info.vendor,
        "OpenGL": info.version,
        "rendered by": "the processor, as no card does" if info.software else "a graphics card",
        "one image": f"{one:.1f} ms at {width}x{height}, shadows included",
        "three cameras": f"{three:.1f} ms",
    }


def _milliseconds(work: Callable[[], object]) -> float:
    """Median time of a call, after a first one that does not count."""
    work()
    return 1000 * median(repeat(work, number=1, repeat=FRAMES))


_STYLES = {"ok": "green", "note": "yellow", "failed": "bold red", "skipped": "dim"}


def examine_rig(
    rig: str,
    out: Path,
    seconds: float = 10.0,
    hold: bool = True,
    store_reference: bool = False,
) -> None:
    """Look at computer, arms, grippers and cameras of a rig; exit code 1 if a check fails.

    Arms hold where they are for a while, once you have said that they may. Not yet tried on an arm.

    Args:
        rig: The rig's file, simulated, or rehearsal.
        out: Folder of the run, into which doctor.json is written.
        seconds: How long the arms hold, while cameras and commands are counted.
        hold: Let the arms hold; without it nothing is told about control commands.
        store_reference: Store the image of the head camera beside the rig's file: later, doctors
            compare with it whether the camera was moved. Clear the table and bring the arms home
            before.
    """
    if seconds <= 0.0:
        raise AdvisedError("--seconds is more than 0.")
    from duobench.hardware.doctor.checks import write_checks
    from duobench.hardware.doctor.examine import examine
    from duobench.hardware.opening import COMPUTED, open_rig

    known = known_rig(rig)
    reference = None if rig in COMPUTED else Path(rig).with_suffix(".head.png")
    if store_reference and reference is None:
        raise AdvisedError(f"The rig {rig} has no file beside which a reference could be kept.")
    # Where nothing is hardware, time is computed as well: nobody has to wait.
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
    if failed := sum(check.outcome == "failed" for check in checks):
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
            "Both arms will be held where they are. Nobody within reach, a hand on the emergency "
            "stop. Press Enter to go on, or Ctrl-C to leave."
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
        rows.add_row(check.name, Text(check.outcome, style=_STYLES[check.outcome]), found)
    say(rows)
