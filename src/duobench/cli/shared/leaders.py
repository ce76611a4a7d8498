"""What an operator leads with, as options name it, and what is said about a session with it."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from duobench.cli.shared.advice import AdvisedError

if TYPE_CHECKING:
    from duobench.rig_sessions.teleop_page import Timings
    from duobench.teleop.intent import Device
    from duobench.teleop.leaders.device import JointSource

GELLO, LEROBOT = "gello", "lerobot"


def opened_device(
    leader: str | None, device: str, lockstep: bool, ending: ExitStack
) -> tuple[Device, str]:
    """What the operator leads with, and what it is called in recordings.

    Args:
        leader: Leader arms, as the option names them; None for the hands of a page.
        device: What those hands come from.
        lockstep: Whether each message of hands is one control step.
        ending: Lets go of leader arms when it ends.
    """
    from duobench.teleop.hands import HandDevice
    from duobench.teleop.leaders.device import LeaderDevice

    if leader is None:
        return HandDevice(lockstep=lockstep), device
    source = joint_source(leader)
    source.connect()
    ending.callback(source.close)
    return LeaderDevice(source), source.device


def joint_source(leader: str) -> JointSource:
    """The leader arms that an option names."""
    kind, _, what = leader.partition(":")
    if kind == GELLO and what:
        from duobench.teleop.leaders.gello import GelloConfig, GelloSource

        return GelloSource(GelloConfig.read(Path(what)))
    if kind == LEROBOT and what:
        from duobench.teleop.leaders.lerobot_source import LeRobotSource

        return LeRobotSource.make(what)
    raise AdvisedError(f"--leader is gello:FILE or lerobot:KIND, got {leader!r}.")


def times_of(timings: Timings) -> str:
    """What the session's times were, in a few words."""
    summary = timings.summary()
    if "latency_ms" not in summary:
        return ""
    period, latency = summary["period_ms"], summary["latency_ms"]
    return (
        f"; a control step every {period['p50']:.0f} ms (99 %: {period['p99']:.0f}), executed "
        f"{latency['p50']:.0f} ms after the hands' sample arrived"
    )
