"""Serving a page of the package to a browser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from threading import Thread
from typing import TYPE_CHECKING

from duobench.cli.shared.console import say
from duobench.results.folder import RunFolder

if TYPE_CHECKING:
    from duobench.web.server import PageServer


@dataclass(frozen=True, kw_only=True, slots=True)
class PageOptions:
    """Where a page is served."""

    port: int = 0
    """Port of the page; 0 takes a free one."""
    lan: bool = False
    """Let other machines in the network open the page, which is encrypted then."""

    def serve(self, page: str = "live_page.html") -> PageServer:
        """Serve a page; `web.page.assets` says which there are.

        Raises:
            ServingError: The port cannot be had, or there is no certificate for the network.
        """
        from duobench.web.access import make_certificate
        from duobench.web.page import assets
        from duobench.web.server import PageServer

        network = {"host": "0.0.0.0", "certificate": make_certificate()} if self.lan else {}
        server = PageServer(assets(page), port=self.port, **network)
        if server.fingerprint:
            say("SHA-256 of the certificate:", server.fingerprint, soft_wrap=True)
        return server


@contextmanager
def followed(folder: RunFolder, port: int) -> Iterator[None]:
    """Show a run on a page while the block plays it; at its end, the page shows the report."""
    from duobench.evaluation.replay.sources import FollowedRun
    from duobench.evaluation.replay.viewer import Viewer

    with closing(PageOptions(port=port).serve()) as server:
        source = FollowedRun(folder, server, import_tasks=True)  # which the run itself imports
        viewer = Viewer(source, server, source.refresh)
        thread = Thread(target=viewer.run, name="follower", daemon=True)
        thread.start()
        say(f"Watch at {server.url}")
        try:
            yield
        finally:
            viewer.stop()
            thread.join()
            source.wait_for_visitors()
