"""Leader arms that an option names, and what is said about a session with them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from duobench.cli.shared.advice import AdvisedError

if TYPE_CHECKING:
    from duobench.rig_sessions.pacing import Timings
    from duobench.teleop.leaders.device import JointSource

GELLO, LEROBOT = "gello", "lerobot"


def joint_source(leader: str) -> JointSource:
    """The leader arms that an option names."""
    kind, _, what = leader.partition(":")
    if kind == GELLO and what:
        from duobench.teleop.leaders.gello_config import GelloConfig
        from duobench.teleop.leaders.gello_source import GelloSource

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
