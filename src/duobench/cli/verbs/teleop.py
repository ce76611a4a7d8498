"""`duobench teleop`: lead both arms from a page in the browser, or with leader arms, and record."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Literal

import tyro

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import console, counted
from duobench.cli.shared.engine import load_engine
from duobench.cli.shared.interrupt import stopping
from duobench.cli.shared.leaders import opened_device, times_of
from duobench.cli.shared.page import serve_page


def teleop(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    task: tyro.conf.Positional[str],
    out: Path,
    episodes: int = 10,
    operator: str = "",
    device: Literal["mouse", "gamepad", "headset"] = "mouse",
    leader: str | None = None,
    instruction: str = "",
    scripted: bool = False,
    look: str = "default",
    lockstep: bool = False,
    port: int = 0,
    lan: bool = False,
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
        operator: Pseudonym of who leads; it is recorded.
        device: What the operator leads with; it is recorded, and the page takes all of them.
        leader: Leader arms in place of the page's hands: gello:FILE, a configuration of two GELLO
            arms, or lerobot:KIND, a teleoperator of LeRobot with our 16 numbers.
        instruction: What the operator says that the arms will do; the task's own if not given. Both
            are recorded.
        scripted: A program leads through the page, which is recorded as such and never as a person.
        look: How images of the episodes look, unless they are exported with another one.
        lockstep: One control step for each message of the page, and none without: for machines that
            are too slow for real time.
        port: Port of the page; 0 takes a free one.
        lan: Let other machines in the network open the page, which is encrypted then.
    """
    if leader is not None and lockstep:
        raise AdvisedError("Leader arms send no messages to step by: leave out --lockstep.")
    load_engine()
    from duobench.data import Actor, ActorKind
    from duobench.rig_sessions.teleop_page import TeleopPage
    from duobench.rig_sessions.teleoperation import Teleoperation, make_recorder

    with ExitStack() as ending:
        led_by, name = opened_device(leader, device, lockstep, ending)
        kind = ActorKind.SCRIPTED_OPERATOR if scripted else ActorKind.PERSON
        actor = Actor(kind=kind, name=operator, device=name)
        recorder = make_recorder(task, out, actor, action_mode=led_by.action_mode, look=look)
        session = Teleoperation(
            recorder, led_by, episodes=episodes, instruction=instruction, lockstep=lockstep
        )
        ending.callback(session.close)
        server = serve_page(port, lan)
        ending.callback(server.close)
        live = TeleopPage(session, server)
        screen = console()
        screen.print(f"Open {server.url}\nCtrl-C ends the session.")
        with stopping(live.stop):
            timings = live.run()
        kept = counted(session.kept, "episode")
        screen.print(f"{kept} of {task} in {out}{times_of(timings)}")
