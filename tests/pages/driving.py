"""A page that drives, in a real browser, and a small server that notes what it is told."""

import json
import mimetypes
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from importlib import resources
from pathlib import Path
from typing import Any

from playwright.sync_api import Page
from websockets import Headers, Request, Response
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

from tests.pages.windows import complaints_of, started

ASSETS = resources.files("duobench.web") / "assets"
STAND = Path(__file__).with_name("driving.html")
WAIT_S = 20


class Operated:
    """One page that drives, as a server sees it."""

    def __init__(self, page: Page, port: int) -> None:
        self.page = page
        self.port = port
        self.messages: list[dict[str, Any]] = []
        self.complaints = complaints_of(page)
        self.socket: ServerConnection | None = None

    def open(self, host: str = "127.0.0.1") -> None:
        """Load the page and let it drive."""
        self.page.goto(f"http://{host}:{self.port}/")
        self.wait(lambda: self.socket is not None)

    def tell(self, **message: Any) -> None:
        assert self.socket
        self.socket.send(json.dumps(message))

    def wait(self, ready: Callable[[], Any]) -> None:
        """Let the browser go on until something holds."""
        end = time.monotonic() + WAIT_S
        while not ready():
            assert time.monotonic() < end, f"waited in vain; the page said {self.complaints}"
            self.page.wait_for_timeout(20)

    def drive(self) -> None:
        """Make the page the driver, and wait for its first open hands."""
        self.tell(kind="role", role="driver", drivers=1, viewers=0)
        self.settle()

    def hands(self) -> list[dict[str, Any]]:
        return [message for message in self.messages if message["kind"] == "hands"]

    def settle(self) -> dict[str, Any]:
        """The hands in a message that the page sends after now, and after one more."""
        count = len(self.hands())
        self.wait(lambda: len(self.hands()) > count + 2)
        return self.hands()[-1]

    def said(self, kind: str) -> int:
        return sum(message["kind"] == kind for message in self.messages)

    def motion(self, side: str, start: int = 0) -> tuple[list[float], list[dict[str, Any]]]:
        """How far a squeezed hand has moved since a message, x y z, and the squeezed samples."""
        samples = [
            message[side] for message in self.hands()[start:] if message[side]["squeeze"] > 0.5
        ]
        first, last = samples[0]["pose"], samples[-1]["pose"]
        return [last[i] - first[i] for i in range(3)], samples


@contextmanager
def opened(*scripts: Path | str) -> Iterator[Page]:
    """An empty page in a browser; scripts run before those of what it will show."""
    with started() as window:
        context = window.new_context(viewport={"width": 1000, "height": 800})
        for script in scripts:
            if isinstance(script, Path):
                context.add_init_script(path=script)
            else:
                context.add_init_script(script)
        yield context.new_page()


def take_the_drive(page: Page, url: str, show: Callable[[], None]) -> None:
    """Open the page of a session, and press its button; `show` lets the session say where it is."""
    page.goto(url)
    drive = page.get_by_role("button", name="Drive")
    end = time.monotonic() + WAIT_S
    while not drive.is_visible():
        assert time.monotonic() < end, page.locator("body").inner_text()
        show()
        page.wait_for_timeout(50)
    drive.click()


@contextmanager
def operated(*scripts: Path | str, files: dict[str, bytes] | None = None) -> Iterator[Operated]:
    """A page in a browser, with scripts that run before its own, and files beside its own."""
    answer = partial(_answer, files or {})
    served: dict[str, Operated] = {}

    def talk(socket: ServerConnection) -> None:
        seen = served["page"]
        seen.socket = socket
        try:
            for text in socket:
                seen.messages.append(json.loads(text))
        except ConnectionClosed:
            pass

    with serve(talk, "127.0.0.1", 0, process_request=answer) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            with opened(*scripts) as page:
                served["page"] = Operated(page, server.socket.getsockname()[1])
                yield served["page"]
        finally:
            server.shutdown()
            thread.join()


def _answer(
    own: dict[str, bytes], _connection: ServerConnection, request: Request
) -> Response | None:
    path = request.path
    if path == "/ws":
        return None
    if path == "/":
        body = STAND.read_bytes()
        kind = "text/html"
    elif (ASSETS / path[1:]).is_file():
        body = (ASSETS / path[1:]).read_bytes()
        kind = mimetypes.guess_type(path)[0] or "application/octet-stream"
    else:
        body = own.get(path, b"")
        kind = "application/octet-stream"
    headers = Headers({"Content-Type": f"{kind}; charset=utf-8", "Content-Length": str(len(body))})
    return Response(HTTPStatus.OK, "OK", headers, body)
