"""Rigs of franky's arms, and an operator who recovers them; shared by programs that lead them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

from duobench.core.errors import BackendError
from duobench.core.types import SIDES
from duobench.real.duo import FrankaDuo
from duobench.real.rig import MAX_TOOL_SPEED, ArmConfig, ArmDriver, Rig

TRIES = 20


def franky_rig(*, cameras: Sequence[str] = (), **limits: float) -> Rig:
    """Two arms by franky at 127.0.0.1 and 127.0.0.2; everything else is simulated.

    Args:
        cameras: Names of the simulated cameras.
        limits: `speed_fraction` and others of `ArmConfig`; those of a new rig where not given, but
            for the speed of its tools, which is the largest.
    """
    plain = Rig.simulated()
    arms = {
        side: ArmConfig(
            driver=ArmDriver.FRANKY,
            address=f"127.0.0.{side.index + 1}",
            is_realtime=False,
            **{"tool_speed": MAX_TOOL_SPEED, **limits},  # pyright: ignore[reportArgumentType]
        )
        for side in SIDES
    }
    return replace(plain, arms=arms, cameras={name: plain.cameras[name] for name in cameras})


def recover(duo: FrankaDuo) -> None:
    """Recover as an operator does who waits until the arms stand still."""
    for left in reversed(range(TRIES)):
        try:
            duo.supervisor.recover()
            break
        except BackendError:
            if not left:
                raise
            time.sleep(0.5)
    duo.supervisor.confirm()
