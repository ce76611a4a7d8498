"""`duobench teleop`: lead both arms from a page in the browser, or with leader arms, and record."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import tyro

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import console, counted
from duobench.cli.shared.engine import load_engine
from duobench.cli.shared.interrupt import stopping
from duobench.cli.shared.leaders import LeadingOptions, times_of
from duobench.cli.shared.page import PageOptions

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
    from duobench.rig_sessions.teleop_page import TeleopPage
    from duobench.rig_sessions.teleoperation import Teleoperation, make_recorder

    with ExitStack() as ending:
        led_by, actor = leading.open(ending)
        recorder = make_recorder(task, out, actor, action_mode=led_by.action_mode, look=look)
        session = Teleoperation(
            recorder,
            led_by,
            episodes=episodes,
            instruction=leading.instruction,
            lockstep=leading.lockstep,
        )
        ending.callback(session.close)
        server = page.serve()
        ending.callback(server.close)
        live = TeleopPage(session, server)
        screen = console()
        screen.print(f"Open {server.url}\nCtrl-C ends the session.")
        with stopping(live.stop):
            timings = live.run()
        kept = counted(session.kept, "episode")
        screen.print(f"{kept} of {task} in {out}{times_of(timings)}")
