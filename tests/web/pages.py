"""A page as a program: what it hears of its server, over a real socket."""

from __future__ import annotations

import http.client
import json
import ssl
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from websockets.sync import client

TIMEOUT_S = 120

Answer = tuple[int, dict[str, str], bytes]


def get(url: str, path: str, headers: dict[str, str] | None = None, method: str = "GET") -> Answer:
    """Status, headers and content of a path at the server of a page."""
    connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=TIMEOUT_S)
    connection.request(method, path, headers=headers or {})
    response = connection.getresponse()
    content = response.read()
    connection.close()
    return response.status, dict(response.headers), content


@contextmanager
def open_page(
    url: str,
    *,
    query: str | None = None,
    origin: str | None = "own",
    context: ssl.SSLContext | None = None,
) -> Iterator[Page]:
    """A connection, as a page at the address of its server makes it."""
    parts = urlsplit(url)
    own = f"{parts.scheme}://{parts.netloc}"
    with client.connect(
        f"{own.replace('http', 'ws', 1)}/ws?{parts.query if query is None else query}",
        origin=own if origin == "own" else origin,  # pyright: ignore[reportArgumentType]
        ssl=context,
        compression=None,
        open_timeout=TIMEOUT_S,
    ) as connection:
        yield Page(connection)


class Page:
    """One open page."""

    def __init__(self, connection: client.ClientConnection) -> None:
        self.connection = connection
        self.frames: list[bytes] = []

    def say(self, **message: Any) -> None:
        self.connection.send(json.dumps(message))

    def hear(self) -> dict[str, Any]:
        """The next message that is no frame; frames are kept."""
        deadline = time.monotonic() + TIMEOUT_S  # frames may go on when nothing else is said
        while True:
            data = self.connection.recv(max(deadline - time.monotonic(), 0.0))
            if isinstance(data, str):
                return json.loads(data)
            self.frames.append(data)

    def hear_of(self, kind: str, **fields: Any) -> dict[str, Any]:
        """The next message of a kind with these fields."""
        while True:
            message = self.hear()
            if message["kind"] == kind and fields.items() <= message.items():
                return message

    def drive(self, **fields: Any) -> None:
        """Ask to drive, and wait until it is allowed."""
        self.say(kind="drive")
        self.hear_of("role", role="driver", **fields)

    def frame(self) -> bytes:
        """The next frame."""
        while not self.frames:
            data = self.connection.recv(TIMEOUT_S)
            if isinstance(data, bytes):
                self.frames.append(data)
        return self.frames.pop(0)


def unpack_frame(data: bytes) -> tuple[np.ndarray, int, float]:
    """Poses (bodies, 7), step and time of a frame; see `pack_frame`."""
    time_s, step, bodies = struct.unpack_from("<dII", data)
    return np.frombuffer(data, "<f4", 7 * bodies, 24).reshape(bodies, 7), step, time_s


def wait_until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + TIMEOUT_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)
