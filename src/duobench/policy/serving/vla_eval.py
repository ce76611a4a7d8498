"""A policy at a model server of vla-eval 0.8, which is used without vla-eval.

Every message is a map of `type`, `payload`, `seq` and `timestamp`. The client says `hello` first;
`episode_start` and `episode_end` are not answered; an `observation` is answered by an `action` or
an `error` with its `seq`. Images are sent as they are rendered.
"""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any

import msgspec
from websockets.sync.client import ClientConnection

from duobench.errors import DuoBenchError, MachineryError, MessageError, ServingError, escaped
from duobench.policy.batch import Batching, Chunk, Observation
from duobench.policy.policy import PolicyMetadata, dimensions
from duobench.policy.serving.codec import pack, unpack
from duobench.policy.serving.connection import ConnectedPolicy, reported
from duobench.policy.serving.dialect import actions_of
from duobench.policy.serving.limits import VLA_EVAL_PROTOCOL
from duobench.policy.serving.vla_eval_specs import Declared, contradictions
from duobench.versions import __version__

_LONGEST_NAME = 80
"""Characters of a server's name and version that are kept."""


class VlaEvalPolicy(ConnectedPolicy):
    """A policy at a model server, as a plain one; its noise follows from no seed."""

    health_path = "/health"
    _default_format = "vla_eval"
    _seq = 0
    _start_seq = 0
    _is_playing = False

    def close(self) -> None:
        """End the episode, and close the connection."""
        if self._connection is not None:
            with suppress(DuoBenchError), self._exchange() as connection:
                self._end_episode(connection)
        self._drop()

    def _begin(self, connection: ClientConnection, seed: int) -> None:
        """Begin an episode, and end the one before; the server does not answer to it."""
        self._end_episode(connection)
        task = {"name": self._instruction, "seed": seed}
        self._start_seq = self._send(connection, "episode_start", {"task": task})
        self._is_playing = True

    def _end_episode(self, connection: ClientConnection) -> None:
        if self._is_playing:
            self._send(connection, "episode_end", {})
        self._is_playing = False

    def _ask(self, connection: ClientConnection, observation: Observation) -> Chunk:
        """The chunk for an observation; an answer with a single action is a chunk of one."""
        request = self._format.request(observation, self._instruction)
        number = self._send(connection, "observation", request)
        kind, answer, seq = self._receive(connection)
        if kind == "error" and seq in (number, self._start_seq):
            self._drop()  # of one about the start, the observation is still to be answered
            raise reported(str(answer.get("error")))
        if kind not in ("action", "error"):
            raise MessageError(f"An observation is answered by an action, got {kind!r:.40}.")
        if seq != number:
            raise MessageError(f"Message {number} was answered, but the answer is to {seq!r:.40}.")
        actions = actions_of(answer, self._format.actions.key)
        return self._format.chunk([actions] if dimensions(actions) == 1 else actions)

    def _send(self, connection: ClientConnection, kind: str, payload: dict[str, Any]) -> int:
        """Send a message; its number."""
        self._seq += 1
        message = {"type": kind, "payload": payload, "seq": self._seq, "timestamp": time.time()}
        connection.send(pack(message, is_text_keyed=True))
        return self._seq

    def _receive(self, connection: ClientConnection) -> tuple[str, dict[str, Any], int]:
        """Type, payload and number of the next message.

        Raises:
            MessageError: If it is none of the protocol.
        """
        frame = connection.recv(self._left())
        if isinstance(frame, str):
            raise MessageError("A message is binary, got text.")
        message = unpack(frame)
        kind, payload, seq = (message.get(name) for name in ("type", "payload", "seq"))
        if not (isinstance(kind, str) and isinstance(payload, dict) and type(seq) is int):
            raise MessageError("A message has a type, a payload and a seq.")
        return kind, payload, seq

    def _handshake(self, connection: ClientConnection) -> tuple[PolicyMetadata, Batching | None]:
        self._is_playing = False  # the server has ended the episode on the last connection
        ours = {"harness_version": __version__, "protocol_version": VLA_EVAL_PROTOCOL}
        self._send(connection, "hello", ours)
        try:
            kind, hello, _ = self._receive(connection)
        except MessageError as error:
            raise MachineryError(f"What answers is no model server of vla-eval: {error}") from error
        if kind != "hello":
            raise MachineryError(f"A model server of vla-eval says hello first, got {kind!r:.40}.")
        version = hello.get("protocol_version")
        if version != VLA_EVAL_PROTOCOL or isinstance(version, bool):
            raise ServingError(
                f"The server speaks version {version!r:.40} of vla-eval's protocol, this client "
                f"{VLA_EVAL_PROTOCOL}. Servers of vla-eval 0.8 do too."
            )
        try:
            declared = msgspec.convert(hello, Declared)
        except msgspec.ValidationError as error:
            raise ServingError(f"The server describes its policy wrongly: {error}.") from error
        if problems := list(contradictions(declared, self._format)):
            raise ServingError(
                f"The server and the format contradict each other: {'; '.join(problems)}. Use a "
                "format that says what this server does, or a server that was made for this one."
            )
        name = escaped(declared.model_server)[:_LONGEST_NAME] or "vla_eval"
        harness = escaped(declared.harness_version)[:_LONGEST_NAME] or "unknown"
        facts = {key: hello.get(key) for key in ("observation_params", "action_spec")}
        version = f"vla-eval {harness}, {name}"
        return self._metadata_from_format(name, version, (self._format, facts)), None
