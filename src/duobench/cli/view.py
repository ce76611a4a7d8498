"""`duobench view`: a task, recorded episodes or those of a run, in 3D in a browser."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING

import tyro

from duobench.cli.display.console import console
from duobench.cli.doctor import load_engine
from duobench.cli.interrupt import stopping

if TYPE_CHECKING:
    from duobench.web.server import PageServer


def view(
    what: tyro.conf.Positional[str],
    tasks: tuple[str, ...] = (),
    port: int = 0,
    lan: bool = False,
    look: str = "default",
    import_tasks: bool = False,
) -> None:
    """Show a task, a data set or a run on a page in the browser, until Ctrl-C.

    A task is shown as its resets leave it. Recorded episodes are shown as their states were;
    episodes of a run are played again from the joint targets in their records. Everybody who has
    the page open sees the same, and may choose.

    Args:
        what: Id of a task (see: duobench list) or module:ATTRIBUTE, the folder of a data set or of
            a run, or a file that duobench bundle has written.
        tasks: Only the episodes of these tasks; of all if none is named.
        port: Port of the page; 0 takes a free one.
        lan: Let other machines in the network open the page, which is encrypted then.
        look: Look of the scene, without textures: wood_table, dark, random:7, ... (see
            docs/looks.md).
        import_tasks: Import tasks of a run that are not of the benchmark, which runs the code of
            the modules that the run names.
    """
    load_engine()
    from duobench.replay.sources import open_view
    from duobench.replay.viewer import Viewer

    source = open_view(what, look, tasks, import_tasks=import_tasks)
    with closing(serve_page(port, lan)) as server:
        viewer = Viewer(source, server)
        with stopping(viewer.stop):
            console().print(f"Open {server.url}\nCtrl-C ends it.")
            viewer.run()


def serve_page(port: int, lan: bool, page: str = "live_page.html") -> PageServer:
    """Serve a page, to this machine or to the network; `web.page.assets` says which there are.

    Raises:
        ServingError: The port cannot be had, or there is no certificate for the network.
    """
    from duobench.web.access import make_certificate
    from duobench.web.page import assets
    from duobench.web.server import PageServer

    if not lan:
        return PageServer(assets(page), port=port)
    return PageServer(assets(page), host="0.0.0.0", port=port, certificate=make_certificate())
