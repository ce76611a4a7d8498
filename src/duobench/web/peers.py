"""The browsers that are connected: what each is to be sent, and which of them drives."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import msgspec
import websockets
from websockets.asyncio.server import ServerConnection

from duobench.web.messages import FRAMES_HZ

SEND_BUFFER = 16 << 10
"""Bytes that the system keeps for a peer that does not read: a dozen frames, and not seconds."""
FRAME = "frame"
"""Where the newest frame waits; all else that waits is text."""


class Peer:
    """One browser. Of everything the newest waits for it, so that a slow one skips the rest."""

    def __init__(self, connection: ServerConnection) -> None:
        self.connection = connection
        """The connection."""
        self._waiting: dict[str, str | bytes] = {}
        self._changed = asyncio.Event()
        self._next_frame = 0.0
        if raw := connection.transport.get_extra_info("socket"):
            with suppress(OSError):
                raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)

    def put(self, place: str, message: str | bytes) -> None:
        """Let a message wait, in place of what waits there."""
        self._waiting[place] = message
        self._changed.set()

    @property
    def has_waiting(self) -> bool:
        """Whether something waits to be sent."""
        return bool(self._waiting)

    def forget_frame(self) -> None:
        """Drop the frame that waits: it belongs to another scene."""
        self._waiting.pop(FRAME, None)

    def refuse(self, reason: str) -> None:
        """Say why a message was refused."""
        self.put("refused", encode(kind="refused", reason=reason))

    async def send_all(self) -> None:
        """Send what waits, text first, as fast as it is read, until the connection ends."""
        loop = asyncio.get_running_loop()
        with suppress(websockets.ConnectionClosed):
            while True:
                await self._changed.wait()
                self._changed.clear()
                while (text := next((each for each in self._waiting if each != FRAME), None)) or (
                    FRAME in self._waiting and loop.time() >= self._next_frame
                ):
                    await self.connection.send(self._waiting.pop(text or FRAME))
                    if text is None:
                        period = 1 / FRAMES_HZ
                        self._next_frame = max(self._next_frame + period, loop.time() - period / 2)
                if FRAME in self._waiting:
                    loop.call_at(self._next_frame, self._changed.set)


class Peers:
    """All browsers. One of them may drive; the others watch."""

    def __init__(self) -> None:
        self._peers: dict[Peer, None] = {}
        self.driver: Peer | None = None
        """The one that drives."""

    def __len__(self) -> int:
        return len(self._peers)

    def __iter__(self) -> Iterator[Peer]:
        return iter(self._peers)

    def add(self, peer: Peer) -> None:
        """Let another one watch."""
        self._peers[peer] = None
        self._tell_roles()

    def remove(self, peer: Peer) -> bool:
        """Let one leave, which frees its place; whether it drove."""
        self._peers.pop(peer, None)
        was_driver = peer is self.driver
        if was_driver:
            self.driver = None
        self._tell_roles()
        return was_driver

    def let_drive(self, peer: Peer) -> None:
        """Let one drive; whoever drove before watches."""
        self.driver = peer
        self._tell_roles()

    def put(self, place: str, message: str | bytes) -> None:
        """Let a message wait for every one."""
        for peer in self._peers:
            peer.put(place, message)

    def put_to_driver(self, place: str, message: str | bytes) -> None:
        """Let a message wait for the one that drives."""
        if self.driver is not None:
            self.driver.put(place, message)

    def _tell_roles(self) -> None:
        drivers = int(self.driver is not None)
        for peer in self._peers:
            role = "driver" if peer is self.driver else "viewer"
            viewers = len(self._peers) - drivers
            peer.put("role", encode(kind="role", role=role, drivers=drivers, viewers=viewers))


def encode(**fields: Any) -> str:
    """A message as JSON text; numbers that are none become null."""
    return msgspec.json.encode(fields).decode()
