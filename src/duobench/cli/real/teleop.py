"""`duobench real teleop`: lead real arms from a page in the browser, or with leader arms."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Literal

import tyro

from duobench.cli.real.rigs import opened_rig
from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import console, counted
from duobench.cli.shared.engine import load_engine
from duobench.cli.shared.interrupt import stopping
from duobench.cli.shared.leaders import opened_device, times_of
from duobench.cli.shared.page import serve_page


def teleop(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    task: tyro.conf.Positional[str],
    rig: str,
    out: Path,
    episodes: int = 10,
    operator: str = "",
    device: Literal["mouse", "gamepad", "headset"] = "mouse",
    leader: str | None = None,
    instruction: str = "",
    scripted: bool = False,
    lockstep: bool = False,
    guard: bool = True,
    fast: bool = False,
    port: int = 0,
    lan: bool = False,
) -> None:
    """Record episodes that somebody leads on real arms, until Ctrl-C.

    As duobench teleop, on a rig: the page also shows what its cameras see, this terminal asks
    before the arms go home, and the space bar here holds them. Keeping an episode while it runs
    says that the task is solved. Not yet tried on an arm.

    Args:
        task: Id of a task (see: duobench list) or module:ATTRIBUTE.
        rig: File of the rig, rig.json, or simulated for drivers without hardware.
        out: Folder of the data set.
        episodes: How many episodes of the task to keep, those that are there counted.
        operator: Pseudonym of who leads; it is recorded.
        device: What the operator leads with; it is recorded, and the page takes all of them.
        leader: Leader arms in place of the page's hands: gello:FILE or lerobot:KIND.
        instruction: What the operator says that the arms will do; the task's own if not given.
        scripted: A program leads through the page, which is recorded as such.
        lockstep: One control step for each message of the page; for drivers without hardware alone.
        guard: Keep the arms apart and off the table by a simulation of them.
        fast: Do not wait for real time; for drivers without hardware alone.
        port: Port of the page; 0 takes a free one.
        lan: Let other machines in the network open the page, which is encrypted then.
    """
    if lockstep and not fast:
        raise AdvisedError("Real arms do not wait for messages: --lockstep goes with --fast alone.")
    load_engine()
    from duobench.cli.real.terminal import KeyTerminal
    from duobench.data import Actor, ActorKind
    from duobench.rig_sessions.cameras import CameraFeed
    from duobench.rig_sessions.rig_teleoperation import (
        EndedError,
        RigTeleoperation,
        RigTeleopPage,
        make_real_recorder,
    )
    from duobench.rig_sessions.session import HELD_BY_OPERATOR

    with ExitStack() as ending:
        led_by, name = opened_device(leader, device, lockstep, ending)
        kind = ActorKind.SCRIPTED_OPERATOR if scripted else ActorKind.PERSON
        actor = Actor(kind=kind, name=operator, device=name)
        duo = opened_rig(rig, guard=guard, fast=fast)
        terminal = ending.enter_context(KeyTerminal())
        terminal.listen(lambda key: duo.hold(HELD_BY_OPERATOR) if key in {"", " "} else None)
        recorder = make_real_recorder(
            duo, task, out, actor, terminal, action_mode=led_by.action_mode
        )
        ending.callback(recorder.close)
        screen = console()
        with suppress(EndedError):
            session = RigTeleoperation(
                recorder, led_by, episodes=episodes, instruction=instruction, lockstep=lockstep
            )
            ending.callback(session.close)
            server = serve_page(port, lan)
            ending.callback(server.close)
            ending.callback(CameraFeed(duo, server).close)
            live = RigTeleopPage(session, server)
            screen.print(f"Open {server.url}\nCtrl-C ends the session; the space bar holds.")
            with stopping(live.stop):
                timings = live.run()
            screen.print(times_of(timings).removeprefix("; "))
        data = recorder.data
        kept = 0 if data is None else data.kept(recorder.task)
        screen.print(f"{counted(kept, 'episode')} of {task} in {out}")
