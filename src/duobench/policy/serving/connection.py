"""A policy at a server, at the other end of a WebSocket, in any protocol.

What the server's policy does wrong is a `PolicyError`, which fails an episode, and so is a reply
that cannot be read. What happens to the connection is a `MachineryError`, after which an episode
can be played again from its start; where the server is back, a `ConnectionLostError`.
"""

import hashlib
import http.client
import math
import socket
import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, ClassVar

import numpy as np
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
from websockets.frames import CloseCode
from websockets.sync.client import ClientConnection, connect

from duobench.core.errors import (
    LONGEST_TEXT,
    ConnectionLostError,
    MachineryError,
    MessageError,
    PolicyError,
    PolicyTimeoutError,
    ServingError,
    escaped,
)
from duobench.core.machine import HERE
from duobench.policy.batch import Batching, Chunk, Observation
from duobench.policy.policy import PolicyMetadata
from duobench.policy.serving import access, limits
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.codec import pack
from duobench.policy.serving.message_format import MessageFormat, read_format

_RETRY_S = 0.2
"""Pause between attempts to connect, in seconds."""
_SHORTEST_S = 0.2
"""Seconds for opening a connection, at least."""
_NOT_ALLOWED = (401, 403)
_LONGEST_LIST = 1000
"""Characters of a list of names that are kept."""
LOST = (OSError, EOFError, InvalidHandshake, ConnectionClosed)
"""Errors of a missing or lost connection."""
_UNREADABLE = (
    CloseCode.PROTOCOL_ERROR,
    CloseCode.INVALID_DATA,
    CloseCode.MESSAGE_TOO_BIG,
)
"""Close codes of this side for messages that it cannot read."""


class ConnectedPolicy(ABC):
    """A policy at a server; a subclass knows what is said there."""

    metadata: PolicyMetadata
    """Expectations of the policy on the environment."""
    batching: Batching | None
    """Observations in a batch of the server, if it says so."""
    health_path: ClassVar[str]
    """Path at which a server of this kind says that it lives."""
    _default_format: ClassVar[str | None] = None
    """Name of the format of a server for which none is given; None takes openpi's keys."""

    def __init__(self, server: RemoteServer) -> None:
        self._server = server
        default = self._default_format
        self._format = server.message_format or (
            read_format(default) if default else MessageFormat()
        )
        self._ending = ExitStack()
        self._connection: ClientConnection | None = None
        self._served: tuple[PolicyMetadata, Batching | None] | None = None
        self._instruction = ""
        self._most_bytes = limits.MAX_EXTRA
        self._allow(server.wait_s + server.answer_s)
        self._connect()

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode, once more if the connection was lost since the last request."""
        self._instruction = instruction
        for is_last in (self._connection is None, True):
            self._allow(self._server.answer_s)
            try:
                with self._exchange(may_be_old=not is_last) as connection:
                    self._begin(connection, seed)
                return
            except MachineryError:
                if is_last:
                    raise

    def act(self, observation: Observation) -> Chunk:
        """The next actions (H, n)."""
        self._allow(self._server.answer_s)
        if self._connection is None:
            raise MachineryError("The connection to the policy's server is lost.")
        with self._exchange() as connection:
            return self._ask(connection, observation)[: self._server.execute]

    def close(self) -> None:
        """Close the connection."""
        self._drop()

    def _drop(self) -> None:
        self._connection = None
        self._ending.close()

    @abstractmethod
    def _handshake(
        self, connection: ClientConnection
    ) -> tuple[PolicyMetadata, Batching | None]:
        """Say and read what comes first on every connection.

        Return what the policy expects, and how many observations a batch has, if known.
        """

    @abstractmethod
    def _begin(self, connection: ClientConnection, seed: int) -> None:
        """Say that an episode begins."""

    @abstractmethod
    def _ask(self, connection: ClientConnection, observation: Observation) -> Chunk:
        """The server's chunk for an observation, after whose errors the connection can be used."""

    def _metadata_from_format(
        self, name: str, version: str, facts: object
    ) -> PolicyMetadata:
        """Expectations of a policy of others; its version also says in which format."""
        digest = hashlib.sha256(repr(facts).encode(errors="replace")).hexdigest()[:16]
        version = f"{version}, format {digest}, {self._server.executed}"
        return self._format.metadata(name, version)

    def _allow(self, seconds: float) -> None:
        self._asked, self._most_s = time.monotonic(), seconds

    def _left(self) -> float:
        """Seconds that the reply may still take."""
        return max(self._most_s - HERE.seconds_since(self._asked), 0.0)

    def _tell(
        self,
        connection: ClientConnection,
        message: dict[str, Any],
        *,
        is_text_keyed: bool = False,
    ) -> None:
        """Send a message; one that cannot be written is no fault of the server."""
        try:
            data = pack(message, is_text_keyed=is_text_keyed)
        except MessageError as error:
            raise MachineryError(str(error)) from error
        connection.send(data)

    def _heard(self, connection: ClientConnection) -> str | bytes:
        """Next message of the server; time in which this process is stopped does not count."""
        while True:
            try:
                return connection.recv(self._left())
            except TimeoutError:
                if not self._left():
                    raise

    @contextmanager
    def _exchange(self, *, may_be_old: bool = False) -> Iterator[ClientConnection]:
        """Connection, opened if needed; all errors but a policy's own close it.

        One that is old may have been lost before anything was asked.
        """
        try:
            yield self._connection or self._connect()
        except PolicyError:
            raise
        except BaseException as error:
            self._drop()  # a reply that comes late would be taken for the next one
            code = _refused_with(error)
            if isinstance(error, MessageError) or code in _UNREADABLE:
                words = escaped(str(error))
                if code == CloseCode.MESSAGE_TOO_BIG:
                    words = f"more than {self._most_bytes} bytes, which its largest chunk takes."
                raise PolicyError(
                    f"The policy's server sends what cannot be read: {words}"
                ) from error
            if isinstance(error, LOST):
                raise self._lost(error, may_be_old=may_be_old) from error
            raise

    def _lost(
        self, error: BaseException, *, may_be_old: bool
    ) -> PolicyError | MachineryError:
        """Whose fault it is that there was no answer, which takes as long as the server does."""
        fault = f"The connection to the policy's server is lost: {escaped(str(error))}."
        if isinstance(error, TimeoutError):
            late = f"did not answer within {self._server.answer_s:g} s"
            if is_healthy(self._server, self.health_path):
                return PolicyTimeoutError(f"The policy's server lives, but {late}.")
            fault = (
                f"The policy's server {late}, nor does it say at {self.health_path} that "
                "it lives."
            )
        if may_be_old or _is_busy(error):
            return MachineryError(fault)
        self._allow(self._server.wait_s + self._server.answer_s)
        try:
            self._connect()
        except MachineryError as gone:
            return gone.from_message(f"{fault} {gone}")
        self._drop()  # the episode begins anew
        return ConnectionLostError(fault)

    def _has_more(self, connection: ClientConnection) -> bool:
        """Whether the server has sent an unrequested message."""
        try:
            connection.recv(0)
        except TimeoutError:
            return False
        return True

    def _connect(self) -> ClientConnection:
        """Connect, and wait for a server that is not there."""
        give_up = time.monotonic() + min(self._left(), self._server.wait_s)
        while True:
            try:
                connection = self._ending.enter_context(self._opened())
                self._recognize(connection)
            except BaseException as error:
                self._drop()
                if not isinstance(error, LOST):
                    raise
                if time.monotonic() + _RETRY_S >= give_up:
                    fault = escaped(str(error) or type(error).__name__)
                    raise MachineryError(
                        f"The policy's server cannot be reached: {fault}."
                    ) from error
                time.sleep(_RETRY_S)
            else:
                self._connection = connection
                return connection

    def _opened(self) -> ClientConnection:
        """A connection that is new; what cannot be opened is one of `LOST`."""
        try:
            connection = connect(
                self._server.url,
                additional_headers=access.headers(self._server.key),
                open_timeout=max(min(limits.HANDSHAKE_S, self._left()), _SHORTEST_S),
                close_timeout=limits.CLOSE_S,
                ping_interval=None,  # some servers answer nothing at all while they infer
                max_size=limits.MAX_EXTRA,
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

    def _recognize(self, connection: ClientConnection) -> None:
        """Learn what is served: the same as before, or another run begins."""
        try:
            served = self._handshake(connection)
        except ServingError:
            if self._served is None:
                raise
            served = None
        if served is None or self._served not in (None, served):
            raise MachineryError(
                "The server has another policy now than when the run began."
            )
        self._served = served
        self.metadata, self.batching = served
        self._most_bytes = limits.reply_bytes(self.metadata.horizon)
        connection.protocol.max_message_size = self._most_bytes


def _refused_with(error: BaseException) -> int | None:
    """Return the code with which this side closed a connection; None if the other side did."""
    if not isinstance(error, ConnectionClosed) or error.rcvd_then_sent:
        return None
    return error.sent.code if error.sent else None


def _is_busy(error: BaseException) -> bool:
    """Whether a server asks to come again later, as ours does where nothing is wrong with it."""
    closed = isinstance(error, ConnectionClosed) and error.rcvd
    return bool(closed) and closed.code == CloseCode.TRY_AGAIN_LATER


def reported(words: str) -> PolicyError:
    """The error of a policy whose server says in words what went wrong."""
    return PolicyError(
        f"The policy's server reports:\n{escaped(words)[-LONGEST_TEXT:].strip()}"
    )


def actions_of(reply: Any, key: str) -> Any:
    """Return the actions in a reply, which may be all of it; an error if they are missing."""
    if isinstance(reply, np.ndarray):
        return reply
    if not isinstance(reply, dict):
        raise PolicyError(
            f"The policy's server answers with a {type(reply).__name__}, no map."
        )
    kind = reply.get("type")
    if isinstance(kind, str) and kind == "error":
        raise reported(str(reply.get("message")))
    if key not in reply:
        known = escaped(", ".join(sorted(reply)))[:_LONGEST_LIST] or "nothing"
        raise PolicyError(
            f"The policy's server answers without {key!r}; it gives {known}."
        )
    return reply[key]


def is_healthy(server: RemoteServer, path: str = limits.HEALTH_PATH) -> bool:
    """Whether a server says at a path that it lives."""
    parts = server.parts
    kind = (
        http.client.HTTPSConnection
        if parts.scheme == "wss"
        else http.client.HTTPConnection
    )
    connection = kind(parts.hostname or "", parts.port, timeout=limits.HEALTH_S)
    try:
        connection.request("GET", path)
        return connection.getresponse().status == http.HTTPStatus.OK
    except (OSError, http.client.HTTPException):
        return False
    finally:
        connection.close()
