"""`duobench view`: a task, a data set or a run on a page in the browser."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import tyro

from duobench.cli.shared.cameras import read_camera
from duobench.cli.shared.console import say
from duobench.cli.shared.page import PageOptions
from duobench.cli.shared.process import load_engine, stopping
from duobench.results.folder import RunFolder
from duobench.world.robot.cameras import view_from
from duobench.world.robot.gripper import DEFAULT_GRIPPER

_PAGE = PageOptions()


def run(
    what: tyro.conf.Positional[str],
    tasks: tuple[str, ...] = (),
    page: tyro.conf.OmitArgPrefixes[PageOptions] = _PAGE,
    look: str = "default",
    gripper: str = DEFAULT_GRIPPER,
    camera: str | None = None,
    import_tasks: bool = False,
    follow: bool = False,
) -> None:
    """Show a task, a data set or a run on a page in the browser, until Ctrl-C.

    A task is shown as its resets leave it. Recorded episodes are shown as their states were;
    episodes of a run are played again from the joint targets in their records. Everybody who has
    the page open sees the same, and may choose.

    Args:
        what: Id of a task (see: duobench list) or module:ATTRIBUTE, the folder of a data set or of
            a run, or a file that duobench bundle has written.
        tasks: Only the episodes of these tasks; of all if none is named.
        page: Where the page is served.
        look: Look of the scene, without textures: wood_table, dark, random:7, ... (see
            the page looks).
        gripper: Gripper with which a task is shown; episodes have their own.
        camera: Where the page looks from at first: head, or a camera of your own on the table, as
            JSON or module:NAME.
        import_tasks: Import tasks of episodes that are not of the benchmark, which runs the code of
            the modules that the data set or the run names.
        follow: Follow a run that is going on, or is going to be started: successes so far, the
            time that is left, and every finished episode; at its end the page shows the report.
    """
    load_engine()
    from duobench.evaluation.replay.sources import (
        DataSource,
        FollowedRun,
        open_view,
    )
    from duobench.evaluation.replay.viewer import Viewer

    view = None if camera is None else view_from(read_camera(camera))
    source = (
        None
        if follow
        else open_view(
            what,
            look,
            tasks,
            import_tasks=import_tasks,
            view=view,
            gripper=gripper,
        )
    )
    with closing(page.serve()) as server:
        run = None
        if source is None:
            folder = RunFolder(Path(what))
            source = run = FollowedRun(
                folder, server, look, tasks, import_tasks=import_tasks, view=view
            )
        refresh = (
            source.refresh if isinstance(source, DataSource | FollowedRun) else None
        )
        viewer = Viewer(source, server, refresh)
        with stopping(viewer.stop):
            say(f"Open {server.url}\nCtrl-C ends it.")
            viewer.run()
        if run is not None:
            run.wait_for_visitors()
