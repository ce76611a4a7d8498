"""`duobench real record`: record what a policy does on real arms."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import tyro

from duobench.cli.real.rigs import RigOptions
from duobench.cli.shared.console import console, counted
from duobench.cli.shared.engine import load_engine
from duobench.cli.shared.interrupt import stopping


def record(  # noqa: PLR0913, PLR0917 - each is an argument of the command line
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
    from duobench.cli.real.terminal import KeyTerminal
    from duobench.data import DataSet
    from duobench.rig_sessions.recording import RigRecording, find_policy
    from duobench.rig_sessions.session import HELD_BY_OPERATOR

    with ExitStack() as ending:
        source = find_policy(policy, tempo)
        duo = rig.open()
        data = DataSet.open(out, how=f"duobench real record --policy {policy}")
        terminal = ending.enter_context(KeyTerminal())
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
        with stopping(lambda: duo.hold(HELD_BY_OPERATOR)):
            kept = session.run()
    console().print(f"{counted(kept, 'episode')} of {task} in {out}")
