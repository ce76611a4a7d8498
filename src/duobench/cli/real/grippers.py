"""`duobench real grippers`: how the grippers of a rig are."""

from __future__ import annotations

from contextlib import closing

from duobench.cli.shared.console import say
from duobench.cli.shared.process import stopping
from duobench.cli.shared.rigs import RigOptions, activate_grippers, confirm
from duobench.core.types import Side


def run(
    rig: str,
    activate: bool = False,
    open: tuple[Side, ...] = (),
    fast: bool = False,
) -> None:
    """Say how the grippers are; activate them or open hands once you have typed the word.

    A gripper that was switched off has forgotten its activation, and moves nowhere before it is
    activated: its fingers close and open. Open hands after an episode that ended with something in
    them. The arms stay where they are; Ctrl-C stops the fingers.

    Args:
        rig: The rig's file, rig.json, or rehearsal, a rig without hardware.
        activate: Activate those that are not active, or have a fault.
        open: Open these hands: left, right, or both names.
        fast: Do not wait for the clock, which only rigs without hardware can do.
    """
    with closing(RigOptions(rig=rig, fast=fast).open()) as duo:
        duo.start()
        if activate:
            activate_grippers(duo)
        if open:
            confirm(
                f"Is what is held ({' and '.join(open)}) kept from falling?", "open"
            )
            with stopping(lambda: duo.hold("Ctrl-C.")):
                duo.hands.open(open)
        for side, reading in duo.gripper_readings().items():
            state = "active" if reading.is_active else "not active"
            holds = ", holds something" if reading.has_object else ""
            fault = "" if reading.fault is None else f"; {reading.fault.text}"
            say(
                f"The {side} gripper: {state}, opening {reading.opening:.2f}{holds}{fault}"
            )
