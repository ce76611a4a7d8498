"""The connection to a policy's server, whatever is said on it.

What the server's policy does wrong is a `PolicyError`, which fails an episode. What happens to the
connection is a `MachineryError`, after which an episode can be played again from its start. Nothing
is read from a connection after an answer that did not come in time: it would be the late one.
"""

from __future__ import annotations

import http.client
import math
import socket
import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import ClassVar

from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from duobench.errors import (
    LONGEST_TEXT,
    DuoBenchError,
    MachineryError,
    MessageError,
    PolicyError,
    PolicyTimeoutError,
    ServingError,
    printable,
)
from duobench.policy.serving import access, limits
from duobench.policy.serving.address import RemoteServer

_RETRY_S = 0.2
"""Pause between attempts to connect, in seconds."""
_NOT_ALLOWED = (401, 403)


class ConnectedPolicy(ABC):
    """A policy at the other end of a WebSocket; a subclass knows what is said there."""

    health_path: ClassVar[str]
    """Where a server of this kind says that it lives."""

    def __init__(self, server: RemoteServer) -> None:
        """Connect.

        Args:
            server: Where the policy is served.

        Raises:
            ServingError: If the server asks for another key, or cannot be understood.
            MachineryError: If there is no server.
        """
        self._server = server
        self._ending = ExitStack()
        self._connection: ClientConnection | None = None
        self._was_let_in = False
        self._deadline = time.monotonic() + server.wait_s + server.answer_s
        self._connect()

    def close(self) -> None:
        """Close the connection."""
        self._drop()

    @abstractmethod
    def _greet(self, connection: ClientConnection) -> None:
        """Say and read what comes first on every connection.

        Raises:
            ServingError: If the server speaks otherwise.
            MachineryError: If what answers is no such server, or has another policy than before.
        """

    def _start_clock(self) -> None:
        """From now on an answer may take as long as it may."""
        self._deadline = time.monotonic() + self._server.answer_s

    def _begin(self, start: Callable[[], None]) -> None:
        """Begin an episode, once more if the connection was lost while nobody asked.

        Raises:
            MachineryError: If the server cannot be reached.
        """
        is_fresh = self._connection is None
        try:
            start()
        except MachineryError:
            if is_fresh:
                raise
            start()

    def _left(self) -> float:
        """Seconds that the answer may still take."""
        return max(self._deadline - time.monotonic(), 0.0)

    @contextmanager
    def _talking(self) -> Iterator[ClientConnection]:
        """The connection, made if there is none; whatever goes wrong in the block ends it."""
        try:
            yield self._connection or self._connect()
        except BaseException as error:
            self._drop()
            if isinstance(error, TimeoutError):
                raise self._late() from error
            if isinstance(error, ConnectionClosed | OSError):
                raise MachineryError(
                    f"The connection to the policy's server is lost: {printable(str(error))}."
                ) from error
            if isinstance(error, MessageError):
                raise MachineryError(
                    f"The policy's server cannot be understood: {error}"
                ) from error
            raise

    def _late(self) -> DuoBenchError:
        """Whose fault it is that there was no answer: a server that still lives has waited too."""
        if is_healthy(self._server, self.health_path):
            return PolicyTimeoutError(
                f"The policy's server lives, but did not answer within {self._server.answer_s:g} s."
            )
        return MachineryError(
            f"The policy's server did not answer within {self._server.answer_s:g} s, nor does it "
            f"say at {self.health_path} that it lives."
        )

    def _connect(self) -> ClientConnection:
        """Connect, and wait for a server that is not there."""
        give_up = min(self._deadline, time.monotonic() + self._server.wait_s)
        while True:
            try:
                connection = self._dial()
                self._greet(connection)
            except InvalidStatus as error:
                fault = f"HTTP status {error.response.status_code}"
                if error.response.status_code in _NOT_ALLOWED and not self._was_let_in:
                    raise ServingError(
                        f"The policy's server refuses the key, or asks for one ({fault}). It is "
                        f"read from {access.KEY_VARIABLE} or a file."
                    ) from error
            except (OSError, EOFError, InvalidHandshake, ConnectionClosed) as error:
                fault = str(error) or type(error).__name__
            except BaseException:
                self._drop()
                raise
            else:
                self._connection, self._was_let_in = connection, True
                return connection
            self._drop()
            if time.monotonic() + _RETRY_S >= give_up:
                raise MachineryError(f"The policy's server cannot be reached: {printable(fault)}.")
            time.sleep(_RETRY_S)

    def _dial(self) -> ClientConnection:
        """Connect once."""
        connection = self._ending.enter_context(
            connect(
                self._server.url,
                additional_headers=access.headers(self._server.key),
                open_timeout=max(min(limits.HANDSHAKE_S, self._left()), _RETRY_S),
                close_timeout=limits.CLOSE_S,
                ping_interval=None,  # some servers answer nothing at all while they infer
                max_size=limits.MAX_REPLY,
                compression=None,
                proxy=None,
            )
        )
        timeout = struct.pack("ll", math.ceil(self._server.answer_s), 0)
        connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, timeout)
        return connection

    def _drop(self) -> None:
        """End the connection, without a word."""
        self._connection = None
        self._ending.close()


def reported(words: str) -> PolicyError:
    """The error of a policy whose server says in words what went wrong."""
    return PolicyError(f"The policy's server reports:\n{printable(words)[-LONGEST_TEXT:].strip()}")


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
