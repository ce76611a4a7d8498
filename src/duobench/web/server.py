"""The server of the page: its files, its scenes, and a socket for each browser that has it open."""

import asyncio
import gzip
import http
import logging
import mimetypes
import re
import socket
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import (
    SplitResult,
    parse_qs,
    unquote,
    urlsplit,
)

import websockets
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from duobench.core.errors import DuoBenchError
from duobench.core.serving_thread import ServingThread
from duobench.web.access import Admission, Certificate, check_address
from duobench.web.messages import (
    FRAMES_HZ,
    MAX_MESSAGE,
    Drive,
    PageMessage,
    Ping,
    TakeOver,
    encode,
    reader,
)

_log = logging.getLogger(__name__)

SOCKET_PATH = "/ws"
"""Path at which pages connect."""
MAX_PEERS = 32
"""Browsers at a time."""
MAX_SCENES = 64
"""Scenes that are kept, and so many images; the oldest one gives way."""
IMAGE_KINDS = {
    b"\xff\xd8\xff": "image/jpeg",
    b"\x89PNG": "image/png",
    b"\x1aE\xdf\xa3": "video/webm",
    b"%PDF": "application/pdf",
}
"""Content types of images, films and sheets to print, by their first bytes."""
LONGEST_NAME = 64
"""Characters of the name of a page."""
_PING_S = 10.0
"""Seconds between pings of a browser, and seconds until its answer."""
_TIMEOUT_S = 2.0
"""Seconds for opening a connection, and for saying goodbye."""
_LOOK_S = 0.01
"""Seconds between looks whether browsers have taken waiting messages."""
SEND_BUFFER = 16 << 10
"""Bytes that the system keeps for a peer that does not read: a dozen frames, and not seconds."""
FRAME = "frame"
"""Slot in which the newest frame waits; all else that waits is text."""
_SECURITY = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'self' 'unsafe-inline' data: blob:; frame-ancestors 'none'; base-uri 'none'; "
        "form-action 'none'; object-src 'none'"
    ),
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


_Content = tuple[str, tuple[bytes, str | None]]
"""Content type, and the content with its encoding."""
_Shelf = dict[str, _Content]
"""Content that is served, by its path."""


class Peer:
    """One browser. Of everything the newest waits for it, so that a slow one skips the rest."""

    def __init__(self, connection: ServerConnection) -> None:
        self._connection = connection
        self.page = _page_of(connection)
        """Name that the page made up for itself; empty for a program without one."""
        self.waiting: dict[str, str | bytes] = {}
        """Messages still to be sent, by slot."""
        self._changed = asyncio.Event()
        self._next_frame = 0.0
        raw = connection.transport.get_extra_info("socket")
        if raw:
            with suppress(OSError):
                raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)

    def put(self, place: str, message: str | bytes) -> None:
        """Let a message wait, in place of what waits there."""
        self.waiting[place] = message
        self._changed.set()

    def drop(self) -> None:
        """End a connection that nobody answers any more."""
        self._connection.transport.abort()

    async def send_all(self) -> None:
        """Send what waits, text first, as fast as it is read, until the connection ends."""
        loop = asyncio.get_running_loop()
        with suppress(websockets.ConnectionClosed):
            while True:
                await self._changed.wait()
                self._changed.clear()
                while (
                    text := next((each for each in self.waiting if each != FRAME), None)
                ) or (FRAME in self.waiting and loop.time() >= self._next_frame):
                    await self._connection.send(self.waiting.pop(text or FRAME))
                    if text is None:
                        period = 1 / FRAMES_HZ
                        self._next_frame = max(
                            self._next_frame + period, loop.time() - period / 2
                        )
                if FRAME in self.waiting:
                    loop.call_at(self._next_frame, self._changed.set)


class PageServer:
    """Shows a page with a scene, frames and a status, and takes what people do on it.

    Newest wins: a browser that is slow skips frames and statuses, and slows no other down.

    A page drives again when it comes back after its connection was cut, or after it was reloaded,
    unless another one drove meanwhile. It is known by the field `page` of the address at which it
    connects.

    Args:
        assets: Content type and content by path; "/" is the page.
        host: Address to listen at.
        port: Port to listen at; 0 takes a free one.
        certificate: Encrypts; any host but this machine's own needs one.
    """

    def __init__(
        self,
        assets: Mapping[str, tuple[str, bytes]],
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        certificate: Certificate | None = None,
    ) -> None:
        check_address(host, certificate)
        names = () if certificate is None else certificate.hosts
        self._admission = Admission(names)
        self._files: _Shelf = {
            path: (kind, (gzip.compress(body, mtime=0), "gzip"))
            for path, (kind, body) in assets.items()
        }
        self._scenes: _Shelf = {}
        self._images: _Shelf = {}
        self._folder: Path | None = None
        self._latest: dict[str, str | bytes] = {}
        self._peers: dict[Peer, None] = {}  # in the order in which they came
        self._driver: Peer | None = None
        self._drove = ""  # the page that drives, or drove last
        self.listen(None, lambda _message: None)
        self._server = ServingThread(
            self._serve_peer,
            host,
            port,
            name="page-server",
            ending=self._flush,
            process_request=self._answer,
            ssl=None if certificate is None else certificate.context,
            max_size=MAX_MESSAGE,
            write_limit=MAX_MESSAGE,
            ping_interval=_PING_S,
            ping_timeout=_PING_S,
            open_timeout=_TIMEOUT_S,
            close_timeout=_TIMEOUT_S,
        )
        scheme, name = (
            ("http", host) if certificate is None else ("https", certificate.hosts[0])
        )
        name = f"[{name}]" if ":" in name else name
        self.url = (
            f"{scheme}://{name}:{self._server.port}/?token={self._admission.token}"
        )
        """Address of the page, with the token."""
        self.fingerprint = "" if certificate is None else certificate.fingerprint
        """SHA-256 of the certificate as browsers show it, to compare with; empty without one."""

    def listen(
        self,
        kinds: Any,
        on_message: Callable[[Any], str | None],
        on_driver_lost: Callable[[bool], None] = lambda _gives_way: None,
        watching: str = "",
        anyone: tuple[type[PageMessage], ...] = (),
    ) -> None:
        """Say what becomes of the messages that are not the server's own affair.

        Args:
            kinds: Classes of the messages that the page may send, below `PageMessage`: one, a union
                of them, or None. All others are refused.
            on_message: Called with each message in the server's thread, and must return soon. What
                it returns, or the text of a `DuoBenchError` that it raises, is why the message is
                refused.
            on_driver_lost: Called in the server's thread when the driver has left, or, as it is
                told, had to give way.
            watching: Why messages of those who do not drive are refused; empty takes them too.
            anyone: Classes of messages that are taken from those too.
        """
        own = Ping | Drive | TakeOver
        self._read = reader(own if kinds is None else own | kinds)
        self.on_message, self.on_driver_lost = on_message, on_driver_lost
        self._watching, self._anyone = watching, anyone

    # --- what is shown; from any thread ----------------------------------------------------------

    @property
    def has_viewers(self) -> bool:
        """Whether a browser has the page open; while none has, nothing need be computed."""
        return len(self._peers) > 0

    def publish_scene(self, name: str, data: bytes) -> None:
        """Show a scene file from now on; frames of the one before are dropped.

        The name is letters, digits, '_', '-' and '.'; the same name is the same scene.
        """
        path = f"/scene/{name}.bin"
        self._scenes = _with(self._scenes, path, "application/octet-stream", data)
        url = f"{path}?token={self._admission.token}"
        self._server.call(self._show_scene, encode(kind="scene", name=name, url=url))

    def publish_image(self, name: str, data: bytes) -> str:
        """Give JPEG, PNG, WebM or PDF out from now on, by a name as scenes have it.

        Returns:
            Its address on this server, with the token.
        """
        kind = next(kind for sign, kind in IMAGE_KINDS.items() if data.startswith(sign))
        path = f"/image/{name}"
        self._images = _with(self._images, path, kind, data)
        return f"{path}?token={self._admission.token}"

    def publish_folder(self, folder: Path) -> str:
        """Give the files of a folder out from now on, to those with the token.

        Returns:
            What their addresses begin with on this server; the rest is the path in the folder.
        """
        self._folder = folder.resolve()
        return f"/folder/{self._admission.token}/"

    def publish_frame(self, frame: bytes) -> None:
        """Show a frame; see `web.messages.pack_frame`, or a JPEG where a page shows images."""
        self._server.call(self._show, FRAME, frame)

    def publish_status(self, status: Mapping[str, Any]) -> None:
        """Show a status: all of it, since a browser that comes later gets this one alone."""
        self._server.call(self._show, "status", encode(kind="status", **status))

    def publish_items(self, items: Sequence[Mapping[str, Any]]) -> None:
        """Show a list of what can be chosen, each with an `id` and a `title`."""
        self._server.call(
            self._show,
            "items",
            encode(
                kind="items",
                items=items,
            ),
        )

    def publish_cameras(self, cameras: Sequence[Mapping[str, Any]]) -> None:
        """Show what cameras see, again and again: a page that hears nothing says so.

        Args:
            cameras: Of each its `name`, `title`, address of its newest `image`, `number` of that
                image (None before the first), and `stale_s`, its age in seconds if that is too
                old, else None.
        """
        self._server.call(self._put, "cameras", encode(kind="cameras", cameras=cameras))

    def pulse(
        self,
        side: str,
        strength: float,
        ms: int,
    ) -> None:
        """Let the left or right controller of the driver rumble, at a strength from 0 to 1."""
        text = encode(
            kind="pulse",
            side=side,
            strength=strength,
            ms=ms,
        )
        self._server.call(
            lambda: self._driver and self._driver.put(f"pulse {side}", text)
        )

    def close(self) -> None:
        """Let every browser take what waits for it, then go; closing twice is harmless."""
        self._server.close()

    # --- in the server's thread ------------------------------------------------------------------

    def _show_scene(self, text: str) -> None:
        if self._latest.get("scene") == text:
            return
        self._latest.pop(FRAME, None)
        for peer in self._peers:
            peer.waiting.pop(FRAME, None)
        self._show("scene", text)

    def _show(self, place: str, message: str | bytes) -> None:
        if place == FRAME or self._latest.get(place) != message:
            self._latest[place] = message
            self._put(place, message)

    def _put(self, place: str, message: str | bytes) -> None:
        for peer in self._peers:
            peer.put(place, message)

    def _let_drive(self, peer: Peer | None) -> None:
        """Let one browser drive, or none, and tell all who drives and who watches."""
        self._driver = peer
        if peer is not None:
            self._drove = peer.page
        drivers = int(peer is not None)
        viewers = len(self._peers) - drivers
        for each in self._peers:
            role = "driver" if each is peer else "viewer"
            each.put(
                "role",
                encode(
                    kind="role",
                    role=role,
                    drivers=drivers,
                    viewers=viewers,
                ),
            )

    async def _flush(self) -> None:
        """Give every browser the time to take what waits for it."""
        with suppress(TimeoutError):
            async with asyncio.timeout(_TIMEOUT_S):
                while any(peer.waiting for peer in self._peers):
                    await asyncio.sleep(_LOOK_S)

    def _answer(
        self, connection: ServerConnection, request: Request
    ) -> Response | None:
        """Serve files, and reject clients that may not connect."""
        if getattr(request, "method", "GET") != "GET":  # websockets 16 takes no other
            answer = connection.respond(
                http.HTTPStatus.METHOD_NOT_ALLOWED, "Use GET.\n"
            )
            answer.headers["Allow"] = "GET"
            return answer
        url = urlsplit(request.path)
        if (
            url.path in self._files and url.path != "/"
        ):  # code of ours, which is no secret
            return _found(*self._files[url.path], request)
        if (
            url.path == "/favicon.ico"
        ):  # browsers ask for one, unless a page says that it has none
            return connection.respond(http.HTTPStatus.NO_CONTENT, "")
        return self._answer_owner(connection, request, url)

    def _answer_owner(
        self, connection: ServerConnection, request: Request, url: SplitResult
    ) -> Response | None:
        """Serve a client with the token of this run's pages."""
        in_folder = re.match(r"/folder/([^/]+)/", url.path)  # where links are relative
        if not self._admission.has_token(
            f"token={in_folder[1]}" if in_folder else url.query
        ):
            return connection.respond(http.HTTPStatus.FORBIDDEN, _NO_TOKEN)
        if url.path == SOCKET_PATH:
            return self._rejection(connection, request)
        found = self._shown(url.path)
        if found is not None:
            return _found(*found, request)
        return connection.respond(http.HTTPStatus.NOT_FOUND, "There is nothing here.\n")

    def _shown(self, path: str) -> _Content | None:
        """Content for those with the token."""
        for shelf in (self._files, self._scenes, self._images):
            if path in shelf:
                return shelf[path]
        if self._folder and (name := re.fullmatch(r"/folder/[^/]+/(.+)", path)):
            file = (self._folder / unquote(name[1])).resolve()
            if not (file.is_relative_to(self._folder) and file.is_file()):
                return None
            kind = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
            return kind, (file.read_bytes(), None)
        return None

    def _rejection(
        self, connection: ServerConnection, request: Request
    ) -> Response | None:
        """Reason why a page may not connect; None if it may."""
        origins, hosts = (request.headers.get_all(name) for name in ("Origin", "Host"))
        origin = origins[0] if origins else None
        unclear = len(origins) > 1 or len(hosts) != 1
        if unclear or not self._admission.is_own_page(origin, hosts[0]):
            return connection.respond(
                http.HTTPStatus.FORBIDDEN, "Pages of others may not connect."
            )
        if len(self._peers) >= MAX_PEERS:
            return connection.respond(
                http.HTTPStatus.SERVICE_UNAVAILABLE, "Too many browsers.\n"
            )
        return None

    async def _serve_peer(self, connection: ServerConnection) -> None:
        peer = Peer(connection)
        self._peers[peer] = None
        is_back = peer.page != "" and peer.page == self._drove
        if is_back and self._driver is not None:  # cut off without a goodbye
            self._driver.drop()
            self._lose_driver(gives_way=False)
        self._let_drive(peer if is_back else self._driver)
        for place in ("scene", "items", "status", FRAME):
            if place in self._latest:
                peer.put(place, self._latest[place])
        sending = asyncio.create_task(peer.send_all())
        try:
            async for data in connection:
                self._receive(peer, data)
        except websockets.ConnectionClosed:
            pass
        finally:
            sending.cancel()
            del self._peers[peer]
            was_driver = peer is self._driver
            self._let_drive(None if was_driver else self._driver)
            if was_driver:
                self._lose_driver(gives_way=False)

    def _receive(self, peer: Peer, data: str | bytes) -> None:
        """Act on a message, or say why not."""
        try:
            reason = self._act(peer, self._read(data))
        except DuoBenchError as error:
            reason = str(error)
        except Exception:  # noqa: BLE001 - the session goes on
            _log.exception(
                "A message from a page made something fail; the session goes on."
            )
            reason = "Something failed here."
        if reason is not None:
            peer.put("refused", encode(kind="refused", reason=reason))

    def _act(self, peer: Peer, message: PageMessage) -> str | None:
        match message:
            case Ping(sent=sent):
                peer.put("pong", encode(kind="pong", sent=sent))
            case Drive() if self._driver not in (None, peer):
                return "Another visitor drives. Watch, or take over."
            case Drive() | TakeOver():
                if self._driver not in (None, peer):
                    self._lose_driver(gives_way=True)
                self._let_drive(peer)
            case _ if (
                self._watching
                and peer is not self._driver
                and not isinstance(message, self._anyone)
            ):
                return self._watching
            case _:
                return self.on_message(message)
        return None

    def _lose_driver(self, *, gives_way: bool) -> None:
        try:
            self.on_driver_lost(gives_way)
        except Exception:  # noqa: BLE001 - the session goes on
            _log.exception(
                "The loss of the driver made something fail; the session goes on."
            )


_NO_TOKEN = (
    "This address lacks its token. Open the whole address that was printed where the page was "
    "started.\n"
)


def _page_of(connection: ServerConnection) -> str:
    """Name of the page that connects; empty without one."""
    assert connection.request is not None
    query = parse_qs(urlsplit(connection.request.path).query)
    return query.get("page", [""])[0][:LONGEST_NAME]


def _with(
    shelf: _Shelf,
    path: str,
    kind: str,
    data: bytes,
) -> _Shelf:
    """A shelf on which something is the newest."""
    others = [other for other in shelf if other != path][-(MAX_SCENES - 1) :]
    return {other: shelf[other] for other in others} | {path: (kind, (data, None))}


def _found(
    kind: str,
    content: tuple[bytes, str | None],
    request: Request,
) -> Response:
    body, encoding = content
    accepted = ",".join(request.headers.get_all("Accept-Encoding"))
    if encoding is not None and encoding not in accepted:
        body, encoding = gzip.decompress(body), None
    headers = Headers(
        {**_SECURITY, "Content-Type": kind, "Content-Length": str(len(body))}
    )
    headers["Vary"] = "Accept-Encoding"
    headers["Connection"] = "close"
    if encoding is not None:
        headers["Content-Encoding"] = encoding
    return Response(http.HTTPStatus.OK, "OK", headers, body)
