"""`duobench teleop`: both arms, led by a person and recorded."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from pathlib import Path

import tyro

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import counted, say
from duobench.cli.shared.leading import LeadingOptions, lead
from duobench.cli.shared.page import PageOptions
from duobench.cli.shared.process import load_engine
from duobench.core.files import taken_back
from duobench.tasks import catalog
from duobench.world.robot.frames import robot_with
from duobench.world.robot.gripper import DEFAULT_GRIPPER

_LEADING, _PAGE = LeadingOptions(), PageOptions()


def run(
    task: tyro.conf.Positional[str | None] = None,
    *,
    out: Path,
    plan: str | None = None,
    episodes: int = 10,
    look: str = "default",
    gripper: str = DEFAULT_GRIPPER,
    leading: tyro.conf.OmitArgPrefixes[LeadingOptions] = _LEADING,
    page: tyro.conf.OmitArgPrefixes[PageOptions] = _PAGE,
) -> None:
    """Record episodes that an operator leads from a page in the browser, until Ctrl-C.

    Open the printed address, and lead both arms by mouse and keys, gamepad or headset; the page
    says how. The environment decides success, and you say which episodes are kept. Layouts are
    those of the split train, and those that were given up come back at the end. The same command
    goes on with a data set until it has as many episodes.

    With --policy, the policy plays and you correct it; rows say who led.

    Args:
        task: Id of a task (see: duobench list) or module:ATTRIBUTE; or name several by --plan.
        out: Folder of the data set.
        plan: Tasks, layouts of each, and how often each is led: 11x50 for all tasks,
            bin_sort,carry_pot x 20 x 2 for two of them. Each task follows on the page by itself;
            several operators, each with a process of their own, lead different ones.
        episodes: How many episodes of the one task to keep, those that are there counted.
        look: How images of the episodes look, unless they are exported with another one.
        gripper: Gripper on both arms, such as franka_hand, or module:ATTRIBUTE.
        leading: Who leads the arms, and with what.
        page: Where the page is served.
    """
    if leading.leader is not None and leading.lockstep:
        raise AdvisedError(
            "Leader arms send no messages to step by: leave out --lockstep."
        )
    if (task is None) == (plan is None):
        raise AdvisedError("Name one task, or several by --plan, such as --plan 11x50.")
    load_engine()
    from duobench.data import Actor, DataSet
    from duobench.data.dataset import DESCRIPTION
    from duobench.evaluation.policies import source as find_policy
    from duobench.results.suite import find_tasks
    from duobench.teleop.plan import Plan, PlannedSessions
    from duobench.teleop.teleop_page import TeleopPage
    from duobench.teleop.teleoperation import Teleoperation, make_recorder

    wanted = (
        Plan.parse(plan or "")
        if task is None
        else Plan(
            tasks=(task,),
            layouts=episodes,
        )
    )
    if leading.instruction and len(wanted.tasks) > 1:
        raise AdvisedError(
            "--instruction goes with one task; type those of a plan on the page."
        )
    with taken_back(out, DESCRIPTION), ExitStack() as ending:
        tasks = find_tasks(wanted.tasks)
        led_by = leading.open(
            ending, partial(find_policy, tasks=tasks), robot_with(gripper)
        )

        def make(task: str, actor: Actor) -> Teleoperation:
            """Make the session of a task that an actor leads."""
            recorder = make_recorder(
                task,
                out,
                actor,
                look=look,
                gripper=gripper,
                **led_by.recorder_settings,
            )
            return Teleoperation(
                recorder,
                led_by.device,
                episodes=wanted.layouts,
                times=wanted.times,
                tasks=wanted.ids,
                **led_by.session_settings(recorder),
            )

        data = DataSet.open(out, own_tasks=catalog.import_paths(wanted.tasks))
        sessions = ending.enter_context(
            PlannedSessions(wanted, data, make, led_by.actor)
        )
        session = sessions.next()
        times = ""
        if session is not None:
            server = page.serve()
            ending.callback(server.close)
            live = TeleopPage(session, server, sessions)
            times = lead(live, server, "Ctrl-C ends the session.")
        for name, progress in sessions.progress.items():
            progress.refresh()
            say(f"{counted(progress.kept, 'episode')} of {name} in {out}{times}")
