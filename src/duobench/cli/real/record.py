"""`duobench real record`: a policy on a rig, recorded."""

from __future__ import annotations

from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

import tyro

from duobench.cli.shared.console import counted, say
from duobench.cli.shared.process import load_engine, stopping
from duobench.cli.shared.rigs import KeyTerminal, RigOptions, hold_and_say
from duobench.core.files import taken_back


def run(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
    policy: str,
    rig: tyro.conf.OmitArgPrefixes[RigOptions],
    task: str,
    out: Path,
    episodes: int = 10,
    tempo: float = 0.5,
    instruction: str = "",
    horizon: int | None = None,
    after_success: float = 1.0,
) -> None:
    """Record what a policy does on real arms, with an operator at this terminal.

    The operator sends the arms home, places the objects, watches, says with a key how far it came,
    and keeps or discards each episode; nothing moves without a key. Cameras are recorded as videos
    beside the episodes. The same command goes on with a data set until it has as many episodes.
    Not yet tried on an arm.

    Args:
        policy: A policy that sees images, as duobench eval takes it, or the file of a recorded
            episode, whose commands are sent again.
        rig: The rig, and how it is driven.
        task: Id of a task (see: duobench list) or module:ATTRIBUTE.
        out: Folder of the data set.
        episodes: How many episodes of the task to keep, those that are there counted.
        tempo: Part of its speed with which a recorded episode is played.
        instruction: What the policy is told; the task's own words if not given.
        horizon: Control steps of an episode at most; the task's own if not given.
        after_success: Seconds that an episode goes on after success.
    """
    load_engine()
    from duobench.data import DataSet
    from duobench.data.dataset import DESCRIPTION
    from duobench.real.sessions.recording import RigRecording, find_policy

    with taken_back(out, DESCRIPTION), ExitStack() as ending:
        source = find_policy(policy, tempo)
        duo = rig.open()
        data = DataSet.open(out, how=f"duobench real record --policy {policy}")
        terminal = ending.enter_context(closing(KeyTerminal()))
        session = RigRecording(
            duo,
            task,
            data,
            source,
            terminal,
            episodes=episodes,
            instruction=instruction,
            horizon=horizon,
            after_success=after_success,
        )
        ending.callback(session.close)
        with stopping(partial(hold_and_say, duo)) as terminal.on_answer:
            kept = session.run()
    say(f"{counted(kept, 'episode')} of {task} in {out}")
