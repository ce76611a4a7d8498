"""Serving a page of the package to a browser."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from duobench.web.server import PageServer


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
