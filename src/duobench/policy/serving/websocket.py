"""Policies at the other end of a WebSocket, whatever is said there."""

from __future__ import annotations

import http.client
import math
import socket
import struct
from typing import ClassVar

from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from duobench.errors import ServingError
from duobench.policy.serving import access, limits
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.connection import ConnectedPolicy

_NOT_ALLOWED = (401, 403)
_SHORTEST_S = 0.2
"""Seconds for opening a connection, at least."""


class WebSocketPolicy(ConnectedPolicy[ClientConnection]):
    """A policy at the other end of a WebSocket; a subclass knows what is said there."""

    health_path: ClassVar[str]
    """Where a server of this kind says that it lives."""
    _breaks = (OSError, EOFError, InvalidHandshake, ConnectionClosed)

    def _dial(self) -> ClientConnection:
        try:
            connection = connect(
                self._server.url,
                additional_headers=access.headers(self._server.key),
                open_timeout=max(min(limits.HANDSHAKE_S, self._left()), _SHORTEST_S),
                close_timeout=limits.CLOSE_S,
                ping_interval=None,  # some servers answer nothing at all while they infer
                max_size=limits.MAX_REPLY,
                compression=None,
                proxy=None,
            )
        except InvalidStatus as error:
            fault = f"HTTP status {error.response.status_code}"
            if error.response.status_code in _NOT_ALLOWED and self._served is None:
                raise ServingError(
                    f"The policy's server refuses the key, or asks for one ({fault}). It is read "
                    f"from {access.KEY_VARIABLE} or a file."
                ) from error
            raise ConnectionError(fault) from error
        timeout = struct.pack("ll", math.ceil(self._server.answer_s), 0)
        connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, timeout)
        return connection

    def _missing_sign(self) -> str | None:
        lives = is_healthy(self._server, self.health_path)
        return None if lives else f"say at {self.health_path} that it lives"


def is_healthy(server: RemoteServer, path: str = limits.HEALTH_PATH) -> bool:
    """Whether a server says that it lives.

    Args:
        server: The server.
        path: Where it says so; that of `duobench serve`, if not given.
    """
    parts = server.parts
    kind = http.client.HTTPSConnection if parts.scheme == "wss" else http.client.HTTPConnection
    connection = kind(parts.hostname or "", parts.port, timeout=limits.HEALTH_S)
    try:
        connection.request("GET", path)
        return connection.getresponse().status == http.HTTPStatus.OK
    except (OSError, http.client.HTTPException):
        return False
    finally:
        connection.close()
