"""`duobench real teleop`: both arms of a rig, led by a person and recorded."""

from __future__ import annotations

from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

import tyro

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import counted, say
from duobench.cli.shared.leading import LeadingOptions, lead
from duobench.cli.shared.page import PageOptions
from duobench.cli.shared.process import load_engine
from duobench.cli.shared.rigs import KeyTerminal, RigOptions
from duobench.core.files import taken_back

_LEADING, _PAGE = LeadingOptions(), PageOptions()


def run(
    task: tyro.conf.Positional[str],
    rig: tyro.conf.OmitArgPrefixes[RigOptions],
    out: Path,
    episodes: int = 10,
    leading: tyro.conf.OmitArgPrefixes[LeadingOptions] = _LEADING,
    page: tyro.conf.OmitArgPrefixes[PageOptions] = _PAGE,
) -> None:
    """Record episodes that an operator leads on real arms, until Ctrl-C.

    As duobench teleop, on a rig: the page also shows what its cameras see. It is led step by step
    from the page or from this terminal, wherever something is pressed first: grippers, the way
    home, placed, stages by their numbers, solved. The space bar holds the arms at both. Not yet
    tried on an arm.

    Args:
        task: Id of a task (see: duobench list) or module:ATTRIBUTE.
        rig: The rig, and how it is driven.
        out: Folder of the data set.
        episodes: How many episodes of the task to keep, those that are there counted.
        leading: Who leads the arms, and with what.
        page: Where the page is served.
    """
    if leading.lockstep and not rig.fast:
        raise AdvisedError(
            "Real arms do not wait for messages: --lockstep goes with --fast alone."
        )
    load_engine()
    from duobench.data.dataset import DESCRIPTION
    from duobench.real.sessions.cameras import CameraFeed
    from duobench.real.sessions.policy_runner import find_rig_policy
    from duobench.real.sessions.rig_teleoperation import (
        RigTeleoperation,
        RigTeleopPage,
        make_real_recorder,
    )
    from duobench.results.suite import find_tasks

    with taken_back(out, DESCRIPTION), ExitStack() as ending:
        tasks = find_tasks((task,))
        duo = rig.open()
        led_by = leading.open(ending, partial(find_rig_policy, tasks=tasks), duo.robot)
        terminal = ending.enter_context(closing(KeyTerminal()))
        recorder = make_real_recorder(
            duo,
            task,
            out,
            led_by.actor,
            **led_by.recorder_settings,
        )
        ending.callback(recorder.close)
        session = RigTeleoperation(
            recorder,
            led_by.device,
            terminal,
            episodes=episodes,
            **led_by.session_settings(recorder),
        )
        ending.enter_context(session)
        server = page.serve()
        ending.callback(server.close)
        ending.callback(CameraFeed(duo, server).close)
        note = "Ctrl-C ends the session; the space bar holds, here and on the page."
        times = lead(RigTeleopPage(session, server), server, note, terminal.leave)
        say(times.removeprefix("; "))
        data = recorder.data
        kept = 0 if data is None else data.kept(recorder.task)
        say(f"{counted(kept, 'episode')} of {task} in {out}")
