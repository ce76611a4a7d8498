"""`duobench real home`: bring both arms home, slowly, on a way that is free."""

from __future__ import annotations

import sys
from itertools import pairwise

import numpy as np

from duobench.cli.real.rigs import RigOptions
from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import console
from duobench.cli.shared.interrupt import stopping

WORD = "home"
"""What the operator types to confirm."""


def home(rig: str, check: bool = False, fast: bool = False) -> None:
    """Bring both arms home at a tenth of their speed, on a way that the guard found free.

    It says where the arms are and which way they will go, and moves nothing before you typed
    `home`. Ctrl-C brings them to rest. The only emergency stop is that of the hardware.

    Args:
        rig: The rig's file, rig.json, or "simulated" for a rig without hardware.
        check: Only connect, and say where the arms are and which way they would go.
        fast: Do not wait for the clock, which only simulated drivers can do.
    """
    screen = console()
    duo = RigOptions(rig=rig, fast=fast).open()
    try:
        duo.start()
        here = duo.read().joints
        assert duo.guard is not None
        nearest = duo.guard.nearest(here, within=1.0)
        way = duo.path_home()
        screen.print(f"Rig {duo.rig.name}, {duo.rig.hash[:12]}: everything answers.")
        screen.print(f"Nearest to each other: {nearest or 'nothing within a metre.'}")
        turns = [np.abs(b - a).max() for a, b in pairwise([here, *way])]
        screen.print(
            f"The way home has {len(way)} straight part(s); joints turn by up to "
            f"{', '.join(f'{turn:.2f}' for turn in turns)} rad. Then the grippers open."
        )
        if check:
            return
        screen.print(
            "Is nobody within reach, is every hand empty, and is somebody at the emergency stop?"
        )
        screen.print(f"Type {WORD} and Enter to move; anything else ends this.")
        if sys.stdin.readline().strip() != WORD:
            raise AdvisedError("Nothing was moved.")
        duo.supervisor.confirm()
        with stopping(lambda: duo.hold("Ctrl-C.")):
            duo.home()
        screen.print("Both arms are home.")
    finally:
        duo.close()
