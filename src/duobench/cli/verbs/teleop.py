"""`duobench teleop` and `duobench real teleop`: lead both arms, and record."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from duobench.cli.real.rigs import KeyTerminal, RigOptions, hold_and_say
from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import counted, say
from duobench.cli.shared.page import PageOptions
from duobench.cli.shared.process import load_engine, stopping
from duobench.core.files import taken_back

if TYPE_CHECKING:
    from duobench.data import Actor
    from duobench.teleop.intent import Device
    from duobench.teleop.leaders.device import JointSource
    from duobench.teleop.teleop_page import TeleopPage
    from duobench.web.server import PageServer


@dataclass(frozen=True, kw_only=True, slots=True)
class LeadingOptions:
    """Who leads the arms, and with what."""

    operator: str = ""
    """Pseudonym of who leads; it is recorded."""
    leader: str | None = None
    """Leader arms in place of the page's hands: gello:FILE, a configuration of two GELLO arms, or
    lerobot:KIND, a teleoperator of LeRobot with our 16 numbers."""
    instruction: str = ""
    """What the operator says that the arms will do; the task's own if not given. Both are
    recorded."""
    scripted: bool = False
    """A program leads through the page, which is recorded as such and never as a person."""
    lockstep: bool = False
    """One control step for each message of the page, and none without: for machines that are too
    slow for real time, and on a rig for drivers without hardware."""

    def open(self, ending: ExitStack) -> tuple[Device, Actor]:
        """What the operator leads with, which `ending` lets go of, and who is recorded."""
        from duobench.data import Actor, ActorKind
        from duobench.teleop.hands import HandDevice
        from duobench.teleop.leaders.device import LeaderDevice

        if self.leader is None:
            led_by = HandDevice(lockstep=self.lockstep)
        else:
            source = _joint_source(self.leader)
            source.connect()
            ending.callback(source.close)
            led_by = LeaderDevice(source)
        kind = ActorKind.SCRIPTED_OPERATOR if self.scripted else ActorKind.PERSON
        return led_by, Actor(kind=kind, name=self.operator, device=led_by.led_by or None)

    def asked(self) -> dict[str, Any]:
        """What a session takes of them."""
        return {"instruction": self.instruction, "lockstep": self.lockstep}


def _joint_source(leader: str) -> JointSource:
    """The leader arms that an option names."""
    kind, _, what = leader.partition(":")
    if kind == "gello" and what:
        from duobench.teleop.leaders.gello import GelloConfig, GelloSource

        return GelloSource(GelloConfig.read(Path(what)))
    if kind == "lerobot" and what:
        from duobench.teleop.leaders.lerobot_source import LeRobotSource

        return LeRobotSource.make(what)
    raise AdvisedError(f"--leader is gello:FILE or lerobot:KIND, got {leader!r}.")


def _led(
    live: TeleopPage, server: PageServer, note: str, on_stop: Callable[[], None] = lambda: None
) -> str:
    """Run a session on its page; what its times were, in a few words."""
    say(f"Open {server.url}\n{note}")

    def stop() -> None:
        live.stop()
        on_stop()

    with stopping(stop):
        summary = live.run().summary()
    if "latency_ms" not in summary:
        return ""
    period, latency = summary["period_ms"], summary["latency_ms"]
    return (
        f"; a control step every {period['p50']:.0f} ms (99 %: {period['p99']:.0f}), executed "
        f"{latency['p50']:.0f} ms after the hands' sample arrived"
    )


_LEADING, _PAGE = LeadingOptions(), PageOptions()


def teleop(
    task: tyro.conf.Positional[str],
    out: Path,
    episodes: int = 10,
    look: str = "default",
    leading: tyro.conf.OmitArgPrefixes[LeadingOptions] = _LEADING,
    page: tyro.conf.OmitArgPrefixes[PageOptions] = _PAGE,
) -> None:
    """Record episodes that somebody leads from a page in the browser, until Ctrl-C.

    Open the printed address, and lead both arms by mouse and keys, gamepad or headset; the page
    says how. The environment decides success, and you say which episodes are kept. Layouts are
    those of the split train. The same command goes on with a data set until it has as many
    episodes.

    Args:
        task: Id of a task (see: duobench list) or module:ATTRIBUTE.
        out: Folder of the data set.
        episodes: How many episodes of the task to keep, those that are there counted.
        look: How images of the episodes look, unless they are exported with another one.
        leading: Who leads the arms, and with what.
        page: Where the page is served.
    """
    if leading.leader is not None and leading.lockstep:
        raise AdvisedError("Leader arms send no messages to step by: leave out --lockstep.")
    load_engine()
    from duobench.data.dataset import DESCRIPTION
    from duobench.teleop.teleop_page import TeleopPage
    from duobench.teleop.teleoperation import Teleoperation, make_recorder

    with taken_back(out, DESCRIPTION), ExitStack() as ending:
        led_by, actor = leading.open(ending)
        recorder = make_recorder(task, out, actor, action_mode=led_by.action_mode, look=look)
        session = ending.enter_context(
            Teleoperation(recorder, led_by, episodes=episodes, **leading.asked())
        )
        server = page.serve()
        ending.callback(server.close)
        times = _led(TeleopPage(session, server), server, "Ctrl-C ends the session.")
        say(f"{counted(session.kept, 'episode')} of {task} in {out}{times}")


def teleop_rig(
    task: tyro.conf.Positional[str],
    rig: tyro.conf.OmitArgPrefixes[RigOptions],
    out: Path,
    episodes: int = 10,
    leading: tyro.conf.OmitArgPrefixes[LeadingOptions] = _LEADING,
    page: tyro.conf.OmitArgPrefixes[PageOptions] = _PAGE,
) -> None:
    """Record episodes that somebody leads on real arms, until Ctrl-C.

    As duobench teleop, on a rig: the page also shows what its cameras see, this terminal asks
    before the arms go home, and the space bar here holds them. Keeping an episode while it runs
    says that the task is solved. Not yet tried on an arm.

    Args:
        task: Id of a task (see: duobench list) or module:ATTRIBUTE.
        rig: The rig, and how it is driven.
        out: Folder of the data set.
        episodes: How many episodes of the task to keep, those that are there counted.
        leading: Who leads the arms, and with what.
        page: Where the page is served.
    """
    if leading.lockstep and not rig.fast:
        raise AdvisedError("Real arms do not wait for messages: --lockstep goes with --fast alone.")
    load_engine()
    from duobench.data.dataset import DESCRIPTION
    from duobench.real.sessions.cameras import CameraFeed
    from duobench.real.sessions.operator import hold_by_key
    from duobench.real.sessions.rig_teleoperation import (
        EndedError,
        RigTeleoperation,
        RigTeleopPage,
        make_real_recorder,
    )

    with taken_back(out, DESCRIPTION), ExitStack() as ending:
        led_by, actor = leading.open(ending)
        duo = rig.open()
        terminal = ending.enter_context(closing(KeyTerminal()))
        terminal.listen(partial(hold_by_key, duo))
        recorder = make_real_recorder(duo, task, out, actor, action_mode=led_by.action_mode)
        ending.callback(recorder.close)
        with suppress(EndedError):
            with stopping(partial(hold_and_say, duo)):
                session = RigTeleoperation(
                    recorder, led_by, terminal, episodes=episodes, **leading.asked()
                )
            ending.enter_context(session)
            server = page.serve()
            ending.callback(server.close)
            ending.callback(CameraFeed(duo, server).close)
            note = "Ctrl-C ends the session; the space bar holds."
            times = _led(RigTeleopPage(session, server), server, note, terminal.leave)
            say(times.removeprefix("; "))
        data = recorder.data
        kept = 0 if data is None else data.kept(recorder.task)
        say(f"{counted(kept, 'episode')} of {task} in {out}")
