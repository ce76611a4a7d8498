"""`duobench real home`: both arms of a rig, brought home."""

from __future__ import annotations

from contextlib import closing
from itertools import pairwise

import numpy as np

from duobench.cli.shared.advice import Advice, advising
from duobench.cli.shared.console import say
from duobench.cli.shared.process import stopping
from duobench.cli.shared.rigs import RigOptions, activate_grippers, confirm
from duobench.core.errors import BackendError

GRIPPERS: Advice = {
    BackendError: "Hands are opened by duobench real grippers --open left right."
}


WORD = "home"
"""Word that the operator types to confirm."""


def run(
    rig: str, check: bool = False, fast: bool = False, with_object: bool = False
) -> None:
    """Bring both arms home at a tenth of their speed, on a way that the guard found free.

    It says where the arms are and which way they will go, and moves nothing before you typed
    `home`. Ctrl-C brings them to rest. The only emergency stop is that of the hardware.

    Args:
        rig: The rig's file, rig.json, or rehearsal, a rig without hardware.
        check: Only connect, and say where the arms are and which way they would go.
        fast: Do not wait for the clock, which only rigs without hardware can do.
        with_object: Carry home what one hand holds, where it is let go.
    """
    with closing(RigOptions(rig=rig, fast=fast).open()) as duo:
        duo.start()
        here = duo.read().joints
        assert duo.guard is not None
        nearest = duo.guard.nearest(here, within=1.0)
        way = duo.path_home()
        fault = duo.health()
        say(
            f"Rig {duo.rig.name}, {duo.rig.hash[:12]}: {fault or 'everything answers.'}"
        )
        say(f"Nearest to each other: {nearest or 'nothing within a metre.'}")
        turns = [np.abs(b - a).max() for a, b in pairwise([here, *way])]
        say(
            f"The way home has {len(way)} straight part(s); joints turn by up to "
            f"{', '.join(f'{turn:.2f}' for turn in turns)} rad. Then the grippers open."
        )
        if check:
            return
        activate_grippers(duo)
        if duo.fault is not None:
            confirm(
                f"{duo.held} Is it set right, so that it may be cleared?", "recover"
            )
            duo.supervisor.recover()
        with advising(GRIPPERS):
            duo.hands.check_free(with_object=with_object)
        confirm("Is everyone out of reach, and is a hand at the emergency stop?", WORD)
        duo.supervisor.confirm()
        with stopping(lambda: duo.hold("Ctrl-C.")):
            duo.home(with_object=with_object)
        say("Both arms are home.")
