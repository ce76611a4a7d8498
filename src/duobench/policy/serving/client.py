"""A policy at the other end of a WebSocket, in the dialects that openpi's protocol is spoken in.

What the server's policy does wrong is a `PolicyError`, which fails an episode. What happens to the
connection is a `MachineryError`, after which an episode can be played again from its start. Nothing
is read from a connection after an answer that did not come in time: it would be the late one.
"""

from __future__ import annotations

import hashlib
import http.client
import math
import socket
import struct
import time
from contextlib import ExitStack
from dataclasses import fields, replace
from typing import Any

import msgspec
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
from duobench.policy.batch import Batching, Chunk, Observation
from duobench.policy.protocol import PolicyMetadata, as_chunk
from duobench.policy.serving import access, limits
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.codec import pack, read, unpack
from duobench.policy.serving.dialect import OURS, Dialect, actions_of, dialect_of
from duobench.policy.serving.layout import Layout
from duobench.policy.serving.limits import HEALTH_PATH, PROTOCOL

_RETRY_S = 0.2
"""Pause between attempts to connect, in seconds."""
_NOT_ALLOWED = (401, 403)


class RemotePolicy:
    """A served policy, as a plain one."""

    def __init__(self, server: RemoteServer) -> None:
        """Connect, and learn what is served.

        Args:
            server: Where it is served.

        Raises:
            ServingError: If the server asks for another key, or cannot be understood.
            MachineryError: If there is no server.
        """
        self._server = server
        self._ending = ExitStack()
        self._connection: ClientConnection | None = None
        self._hello: dict[str, Any] | None = None
        self._deadline = time.monotonic() + server.wait_s + server.answer_s
        self._connect()
        hello = self._hello or {}
        self._dialect = dialect_of(hello, server.parts.path)
        self.metadata, self.batching = _described(hello, self._dialect, server)
        """What the policy expects of the environment, and how it is asked where that is known."""
        self._instruction = ""
        self._seed = 0
        self._session_id: str | None = None

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode, with a connection of its own where the server knows no other way.

        Raises:
            PolicyError: If the policy fails, or is too slow.
            MachineryError: If the server cannot be reached.
        """
        self._deadline = time.monotonic() + self._server.answer_s
        self._instruction, self._seed = instruction, seed
        self._session_id = self._dialect.session_id()
        if not self._dialect.has_reset:
            self.close()
            self._connect()
            return
        is_fresh = self._connection is None
        try:
            self._send_reset()
        except MachineryError:  # perhaps lost while nobody asked; the episode has not begun
            if is_fresh:
                raise
            self._send_reset()

    def act(self, observation: Observation) -> Chunk:
        """The next actions (H, n).

        Raises:
            PolicyError: If the policy fails, is too slow, or gives no chunk of actions.
            MachineryError: If the connection is lost, or what comes cannot be read.
        """
        self._deadline = time.monotonic() + self._server.answer_s
        if self._connection is None:
            raise MachineryError("The connection to the policy's server is lost.")
        layout = self._server.layout
        if layout is not None:
            request = layout.request(observation, self._instruction)
        else:
            prompt = {} if self._dialect is OURS else {"prompt": self._instruction}
            request = {**observation, **prompt}
        request = self._dialect.request(request, self._seed, self._session_id)
        answer = self._exchange(request)
        actions = actions_of(answer, "actions" if layout is None else layout.actions.key)
        chunk = as_chunk(actions, width=None) if layout is None else layout.chunk(actions)
        return chunk[: self._server.execute]

    def close(self) -> None:
        """Close the connection."""
        self._connection = None
        self._ending.close()

    def _send_reset(self) -> None:
        message = self._dialect.reset(self._instruction, self._seed, self._session_id)
        self._exchange(message, is_text=self._dialect.is_reset_answered_in_text)

    def _exchange(self, message: dict[str, Any], *, is_text: bool = False) -> Any:
        """Send a message and wait for its answer."""
        try:
            connection = self._connection or self._connect()
            connection.send(pack(message))
            reply = connection.recv(self._left())
            if isinstance(reply, str):
                if is_text:
                    return {}
                words = printable(reply)[-LONGEST_TEXT:].strip()
                raise PolicyError(f"The policy's server reports:\n{words}")
            return read(reply)
        except BaseException as error:
            self.close()
            if isinstance(error, TimeoutError):
                raise self._late() from error
            if isinstance(error, ConnectionClosed | OSError):
                raise MachineryError(
                    f"The connection to the policy's server is lost: {error}."
                ) from error
            if isinstance(error, MessageError):
                raise MachineryError(
                    f"The policy's server cannot be understood: {error}"
                ) from error
            raise

    def _left(self) -> float:
        """Seconds that the answer may still take."""
        return max(self._deadline - time.monotonic(), 0.0)

    def _late(self) -> DuoBenchError:
        """Whose fault it is that there was no answer: a server that still lives has waited too."""
        if is_healthy(self._server):
            return PolicyTimeoutError(
                f"The policy's server lives, but did not answer within {self._server.answer_s:g} s."
            )
        return MachineryError(
            f"The policy's server did not answer within {self._server.answer_s:g} s, nor does it "
            f"say at {HEALTH_PATH} that it lives."
        )

    def _connect(self) -> ClientConnection:
        """Connect, and wait for a server that is not there."""
        give_up = min(self._deadline, time.monotonic() + self._server.wait_s)
        while True:
            try:
                return self._dial()
            except InvalidStatus as error:
                fault = f"HTTP status {error.response.status_code}"
                if error.response.status_code in _NOT_ALLOWED and self._hello is None:
                    raise ServingError(
                        f"The policy's server refuses the key, or asks for one ({fault}). It is "
                        f"read from {access.KEY_VARIABLE} or a file."
                    ) from error
            except (OSError, EOFError, InvalidHandshake, ConnectionClosed) as error:
                fault = str(error) or type(error).__name__
            self.close()
            if time.monotonic() + _RETRY_S >= give_up:
                raise MachineryError(f"The policy's server cannot be reached: {fault}.")
            time.sleep(_RETRY_S)

    def _dial(self) -> ClientConnection:
        """Connect once, and read what is served: the same as before, or another run begins."""
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
        first = connection.recv(self._left())
        try:
            hello = unpack(first if isinstance(first, bytes) else first.encode())
        except MessageError as error:
            raise MachineryError(f"What answers is no policy's server: {error}") from error
        if self._hello is not None and hello.get(OURS.name) != self._hello.get(OURS.name):
            raise MachineryError("The server has another policy now than when the run began.")
        self._connection, self._hello = connection, hello
        return connection


def is_healthy(server: RemoteServer) -> bool:
    """Whether a server says that it lives."""
    parts = server.parts
    kind = http.client.HTTPSConnection if parts.scheme == "wss" else http.client.HTTPConnection
    connection = kind(parts.hostname or "", parts.port, timeout=limits.HEALTH_S)
    try:
        connection.request("GET", HEALTH_PATH)
        return connection.getresponse().status == http.HTTPStatus.OK
    except (OSError, http.client.HTTPException):
        return False
    finally:
        connection.close()


def _described(
    hello: dict[str, Any], dialect: Dialect, server: RemoteServer
) -> tuple[PolicyMetadata, Batching | None]:
    """What a server's policy expects, and how it is asked, if it tells."""
    asked = "all" if server.execute is None else f"first {server.execute}"
    if dialect is not OURS:
        described = hashlib.sha256(repr(server.layout).encode()).hexdigest()[:16]
        version = f"{dialect.name}, layout {described}, {asked} actions of a chunk"
        layout = server.layout or Layout()
        return layout.metadata(dialect.name, version, seeded=dialect.has_seed), None
    told = hello[OURS.name]
    try:
        if told["protocol"] != PROTOCOL:
            raise ServingError(
                f"The server speaks version {told['protocol']!r:.20} of the protocol, this client "
                f"{PROTOCOL}. Use the same version of DuoBench on both sides."
            )
        known = {each.name for each in fields(PolicyMetadata)}
        metadata = msgspec.convert(
            {key: value for key, value in told.items() if key in known}, PolicyMetadata
        )
        batching = msgspec.convert({"mode": told["batch"], "size": told["max_batch"]}, Batching)
    except (msgspec.ValidationError, PolicyError, KeyError, TypeError) as error:
        raise ServingError(f"The server describes its policy wrongly: {error}.") from error
    if server.execute is not None and server.execute < (metadata.horizon or math.inf):
        metadata = replace(metadata, version=f"{metadata.version}, {asked} actions of a chunk")
    return metadata, batching
