"""A policy at the other end of a WebSocket, in the dialects that openpi's protocol is spoken in."""

from __future__ import annotations

import hashlib
import math
from dataclasses import fields, replace
from typing import Any

import msgspec
from websockets.sync.client import ClientConnection

from duobench.errors import DuoBenchError, MachineryError, MessageError, PolicyError, ServingError
from duobench.policy.batch import Batching, Chunk, Observation
from duobench.policy.protocol import PolicyMetadata, as_chunk
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.codec import pack, read, unpack
from duobench.policy.serving.connection import ConnectedPolicy, reported
from duobench.policy.serving.dialect import OURS, Dialect, actions_of, dialect_of
from duobench.policy.serving.layout import Layout
from duobench.policy.serving.limits import HEALTH_PATH, PROTOCOL


class RemotePolicy(ConnectedPolicy):
    """A served policy, as a plain one."""

    health_path = HEALTH_PATH

    def __init__(self, server: RemoteServer) -> None:
        """Connect, and learn what is served.

        Args:
            server: Where it is served.

        Raises:
            ServingError: If the server asks for another key, or cannot be understood.
            MachineryError: If there is no server.
        """
        self._hello: dict[str, Any] | None = None
        super().__init__(server)
        hello = self._hello or {}
        self._dialect = dialect_of(hello, server.parts.path)
        try:
            self.metadata, self.batching = _described(hello, self._dialect, server)
            """What the policy expects of the environment, and how it is asked, if it tells."""
        except DuoBenchError:
            self.close()
            raise
        self._instruction = ""
        self._seed = 0
        self._session_id: str | None = None

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode, with a connection of its own where the server knows no other way.

        Raises:
            PolicyError: If the policy fails, or is too slow.
            MachineryError: If the server cannot be reached.
        """
        self._start_clock()
        self._instruction, self._seed = instruction, seed
        self._session_id = self._dialect.session_id()
        if not self._dialect.has_reset:
            self.close()
            self._connect()
            return
        self._begin(self._send_reset)

    def act(self, observation: Observation) -> Chunk:
        """The next actions (H, n).

        Raises:
            PolicyError: If the policy fails, is too slow, or gives no chunk of actions.
            MachineryError: If the connection is lost, or what comes cannot be read.
        """
        self._start_clock()
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

    def _send_reset(self) -> None:
        message = self._dialect.reset(self._instruction, self._seed, self._session_id)
        self._exchange(message, is_text=self._dialect.is_reset_answered_in_text)

    def _exchange(self, message: dict[str, Any], *, is_text: bool = False) -> Any:
        """Send a message and wait for its answer."""
        with self._talking() as connection:
            connection.send(pack(message))
            reply = connection.recv(self._left())
            if not isinstance(reply, str):
                return read(reply)
            if not is_text:
                raise reported(reply)
            return {}

    def _greet(self, connection: ClientConnection) -> None:
        """Read what is served: the same as before, or another run begins."""
        first = connection.recv(self._left())
        try:
            hello = unpack(first if isinstance(first, bytes) else first.encode())
        except MessageError as error:
            raise MachineryError(f"What answers is no policy's server: {error}") from error
        if self._hello is not None and repr(hello.get(OURS.name)) != repr(
            self._hello.get(OURS.name)
        ):
            raise MachineryError("The server has another policy now than when the run began.")
        self._hello = hello


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
        protocol = told.get("protocol") if isinstance(told, dict) else told
        if type(protocol) is not int or protocol != PROTOCOL:
            raise ServingError(
                f"The server speaks version {protocol!r:.20} of the protocol, this client "
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
