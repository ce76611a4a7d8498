"""A policy at the other end of a WebSocket, in the dialects that openpi's protocol is spoken in."""

import math
import uuid
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import msgspec
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from duobench.core.errors import (
    ConnectionLostError,
    MachineryError,
    MessageError,
    PolicyError,
    PolicyFailedError,
    PolicyTimeoutError,
    ServingError,
)
from duobench.policy.batch import Batching, Chunk, Observation
from duobench.policy.policy import PolicyMetadata, as_chunk
from duobench.policy.serving.address import LOOPBACK, RemoteServer
from duobench.policy.serving.codec import read, unpack
from duobench.policy.serving.connection import ConnectedPolicy, actions_of, reported
from duobench.policy.serving.limits import HEALTH_PATH, PROTOCOL

VLLM_PATH = "/v1/realtime/robot/openpi"
"""Path at which vLLM-Omni serves robot policies."""
_ROBOARENA_KEYS = {"needs_session_id", "n_external_cameras", "needs_wrist_camera"}
"""Keys of the first message of a RoboArena server."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Dialect:
    """Dialect of one kind of server, beside plain observations."""

    name: str
    reset: tuple[str, ...] | None = None
    """Fields of the message that begins an episode; None if a new connection does."""
    is_reset_answered_in_text: bool = False
    """Whether that message is answered by text, which otherwise is an error."""
    added: tuple[str, ...] = ()
    """Fields that are added to every observation."""

    def messages(
        self, instruction: str, seed: int
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Message that begins an episode, and the fields added to each of its observations."""
        values = {"endpoint": "infer", "prompt": instruction, "seed": seed}
        values["session_id"] = (
            uuid.uuid4().hex
        )  # a new one for each episode; it decides nothing
        reset = {
            "endpoint": "reset",
            **{name: values[name] for name in self.reset or ()},
        }
        return reset, {name: values[name] for name in self.added}


OURS = Dialect(name="duobench", reset=("prompt", "seed"))
_OPENPI = Dialect(name="openpi")
_ROBOARENA = Dialect(
    name="roboarena", reset=(), is_reset_answered_in_text=True, added=("endpoint",)
)
_ROBOARENA_SESSIONS = replace(
    _ROBOARENA, reset=("session_id",), added=("session_id", "endpoint")
)
_VLLM = Dialect(
    name="vllm-omni",
    reset=("prompt", "seed", "session_id"),
    added=("session_id", "seed"),
)


def dialect_of(handshake: Mapping[str, Any], path: str) -> Dialect:
    """The dialect of a server, by its first message and the path of its address."""
    if "duobench" in handshake:
        return OURS
    if path.rstrip("/") == VLLM_PATH:
        return _VLLM
    if handshake.keys() & _ROBOARENA_KEYS:
        return _ROBOARENA_SESSIONS if handshake.get("needs_session_id") else _ROBOARENA
    return _OPENPI


class OpenpiPolicy(ConnectedPolicy):
    """A served policy, as a plain one."""

    health_path = HEALTH_PATH
    _dialect: Dialect
    _added: Mapping[str, Any] = MappingProxyType({})
    """Values that every observation of the episode also holds."""

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode, with a connection of its own where the server knows no other way.

        So does one on whose connection more has come than was asked for.
        """
        has_more = True
        if self._connection is not None and self._dialect.reset is not None:
            with suppress(ConnectionClosed):
                has_more = self._has_more(self._connection)
        if has_more:
            self._drop()
        super().reset(instruction, seed)

    def _begin(self, connection: ClientConnection, seed: int) -> None:
        message, self._added = self._dialect.messages(self._instruction, seed)
        if self._dialect.reset is not None:
            is_text = self._dialect.is_reset_answered_in_text
            self._request(connection, message, is_text=is_text)

    def _ask(self, connection: ClientConnection, observation: Observation) -> Chunk:
        message_format = self._server.message_format
        if message_format is not None:
            request = message_format.request(observation, self._instruction)
            reply = self._request(connection, {**request, **self._added})
            return message_format.chunk(actions_of(reply, message_format.actions.key))
        prompt = {} if self._dialect is OURS else {"prompt": self._instruction}
        reply = self._request(connection, {**observation, **prompt, **self._added})
        return as_chunk(actions_of(reply, "actions"), width=None)

    def _request(
        self,
        connection: ClientConnection,
        message: dict[str, Any],
        *,
        is_text: bool = False,
    ) -> Any:
        if self._has_more(connection):
            raise MessageError("it has given more than one answer to a request.")
        self._tell(connection, message)
        reply = self._heard(connection)
        if not isinstance(reply, str):
            return read(reply)
        if not is_text:
            self._drop()  # as the server does after such words
            raise self._failure(reply)
        return {}

    def _failure(self, words: str) -> PolicyError:
        return reported(words)

    def _handshake(
        self, connection: ClientConnection
    ) -> tuple[PolicyMetadata, Batching | None]:
        first = self._heard(connection)
        try:
            handshake = unpack(first if isinstance(first, bytes) else first.encode())
        except MessageError as error:
            raise MachineryError(
                f"What answers is no policy's server: {error}"
            ) from error
        server = self._server
        self._dialect = dialect = dialect_of(handshake, server.parts.path)
        if dialect is OURS:
            metadata, batching = _described(handshake[OURS.name], server)
            is_more = metadata.depth or metadata.segmentation or metadata.object_state
            if is_more and server.message_format is not None:
                raise ServingError(
                    "The policy reads the state of the objects, depth or segmentation, for which a "
                    "message format has no place. A server of DuoBench needs no format."
                )
            return metadata, batching
        return self._metadata_from_format(
            dialect.name, dialect.name, server.message_format
        ), None


def _described(facts: Any, server: RemoteServer) -> tuple[PolicyMetadata, Batching]:
    """Metadata and batching of the policy at a server of ours."""
    try:
        protocol = facts.get("protocol") if isinstance(facts, dict) else facts
        if type(protocol) is not int or protocol != PROTOCOL:
            raise ServingError(
                f"The server speaks version {protocol!r:.20} of the protocol, this client "
                f"{PROTOCOL}. Use the same version of DuoBench on both sides."
            )
        metadata = msgspec.convert(facts, PolicyMetadata)
        batching = msgspec.convert(
            {"mode": facts["batch"], "size": facts["max_batch"]}, Batching
        )
    except (msgspec.ValidationError, PolicyError, KeyError, TypeError) as error:
        raise ServingError(
            f"The server describes its policy wrongly: {error}."
        ) from error
    if server.execute is not None and server.execute < (metadata.horizon or math.inf):
        metadata = replace(metadata, version=f"{metadata.version}, {server.executed}")
    return metadata, batching


_MILLI = 1e3


class OwnPolicy(OpenpiPolicy):
    """A policy in a process of its own, whose errors are those of one in this process."""

    intended_action: Any = None
    """Action that it intended last, if it has disturbed it."""
    busy_s: float = 0.0
    """Seconds that it took for its chunks, without waiting."""

    def _connect(self) -> ClientConnection:
        """Connect; a process of this machine that cannot be reached is lost, also if it lives."""
        try:
            return super()._connect()
        except MachineryError as error:
            is_near = self._server.parts.hostname == LOOPBACK
            raise (ConnectionLostError(str(error)) if is_near else error) from error

    def _request(self, *words: Any, **options: Any) -> Any:
        reply = super()._request(*words, **options)
        said = reply if isinstance(reply, dict) else {}
        self.busy_s += said.get("server_timing", {}).get("policy_ms", 0.0) / _MILLI
        self.intended_action = said.get("intended")
        return reply

    def _failure(self, words: str) -> PolicyError:
        timeout = f"{PolicyTimeoutError.__name__}: "
        if words.startswith(timeout):
            return PolicyTimeoutError(words.removeprefix(timeout))
        return PolicyFailedError(words)
