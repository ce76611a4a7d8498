"""`duobench teleop`: both arms, led by a person and recorded."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import tyro

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import counted, say
from duobench.cli.shared.leading import LeadingOptions, lead
from duobench.cli.shared.page import PageOptions
from duobench.cli.shared.process import load_engine
from duobench.core.files import taken_back

_LEADING, _PAGE = LeadingOptions(), PageOptions()


def run(
    task: tyro.conf.Positional[str],
    out: Path,
    episodes: int = 10,
    look: str = "default",
    leading: tyro.conf.OmitArgPrefixes[LeadingOptions] = _LEADING,
    page: tyro.conf.OmitArgPrefixes[PageOptions] = _PAGE,
) -> None:
    """Record episodes that an operator leads from a page in the browser, until Ctrl-C.

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
        raise AdvisedError(
            "Leader arms send no messages to step by: leave out --lockstep."
        )
    load_engine()
    from duobench.data.dataset import DESCRIPTION
    from duobench.teleop.teleop_page import TeleopPage
    from duobench.teleop.teleoperation import Teleoperation, make_recorder

    with taken_back(out, DESCRIPTION), ExitStack() as ending:
        led_by, actor = leading.open(ending)
        recorder = make_recorder(
            task,
            out,
            actor,
            action_mode=led_by.action_mode,
            time_limit_s=leading.limit,
            look=look,
        )
        session = ending.enter_context(
            Teleoperation(
                recorder,
                led_by,
                episodes=episodes,
                **leading.asked(),
            )
        )
        server = page.serve()
        ending.callback(server.close)
        times = lead(TeleopPage(session, server), server, "Ctrl-C ends the session.")
        say(f"{counted(session.kept, 'episode')} of {task} in {out}{times}")
