"""`duobench real teleop`: lead real arms from a page in the browser, or with leader arms."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from pathlib import Path

import tyro

from duobench.cli.real.rigs import RigOptions
from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import console, counted
from duobench.cli.shared.engine import load_engine
from duobench.cli.shared.interrupt import stopping
from duobench.cli.shared.leaders import LeadingOptions, times_of
from duobench.cli.shared.page import PageOptions

_LEADING, _PAGE = LeadingOptions(), PageOptions()


def teleop(
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
    from duobench.cli.real.terminal import KeyTerminal
    from duobench.rig_sessions.cameras import CameraFeed
    from duobench.rig_sessions.rig_teleoperation import (
        EndedError,
        RigTeleoperation,
        RigTeleopPage,
        make_real_recorder,
    )
    from duobench.rig_sessions.session import HELD_BY_OPERATOR

    with ExitStack() as ending:
        led_by, actor = leading.open(ending)
        duo = rig.open()
        terminal = ending.enter_context(KeyTerminal())
        terminal.listen(lambda key: duo.hold(HELD_BY_OPERATOR) if key in {"", " "} else None)
        recorder = make_real_recorder(
            duo, task, out, actor, terminal, action_mode=led_by.action_mode
        )
        ending.callback(recorder.close)
        screen = console()
        with suppress(EndedError):
            session = RigTeleoperation(
                recorder,
                led_by,
                episodes=episodes,
                instruction=leading.instruction,
                lockstep=leading.lockstep,
            )
            ending.callback(session.close)
            server = page.serve()
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
