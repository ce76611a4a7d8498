"""A policy at a model server of vla-eval 0.8, which is asked without vla-eval.

Every message is a map of `type`, `payload`, `seq` and `timestamp`. The client says `hello` first;
`episode_start` and `episode_end` are not answered; an `observation` is answered by an `action` or
an `error` with its `seq`. Images are sent as they are rendered.
"""

from __future__ import annotations

import hashlib
import time
from contextlib import suppress
from typing import Any

import msgspec
import numpy as np
from websockets.sync.client import ClientConnection

from duobench import __version__
from duobench.errors import (
    DuoBenchError,
    MachineryError,
    MessageError,
    ServingError,
    printable,
)
from duobench.policy.batch import Batching, Chunk, Observation
from duobench.policy.protocol import PolicyMetadata, dimensions
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.codec import pack, unpack
from duobench.policy.serving.connection import ConnectedPolicy, reported
from duobench.policy.serving.dialect import actions_of
from duobench.policy.serving.layout import Layout, read_layout
from duobench.policy.serving.limits import VLA_EVAL_HEALTH_PATH, VLA_EVAL_PROTOCOL
from duobench.policy.serving.vla_eval_specs import Declared, contradictions

LAYOUT = "vla_eval"
"""The layout of a server for which no other is given."""
_LONGEST_NAME = 80
"""Characters of a server's name and version that are kept."""


class VlaEvalPolicy(ConnectedPolicy):
    """A policy at a model server, as a plain one; its noise follows from no seed."""

    health_path = VLA_EVAL_HEALTH_PATH
    batching: Batching | None = None
    """How many observations the server answers together, which it does not tell."""

    def __init__(self, server: RemoteServer) -> None:
        """Connect, and compare what the server says about itself with the layout.

        Args:
            server: Where the policy is served.

        Raises:
            ServingError: If the server speaks another version of the protocol, or contradicts the
                layout.
            MachineryError: If there is no server, or what answers is none of vla-eval.
        """
        self._hello: dict[str, Any] | None = None
        self._seq = 0
        self._start_seq = 0
        self._is_playing = False
        self._instruction = ""
        self._layout = server.layout or read_layout(LAYOUT)
        super().__init__(server)
        try:
            self.metadata = _described(self._hello or {}, self._layout, server.execute)
            """What the policy expects of the environment."""
        except DuoBenchError:
            self._drop()
            raise

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode, and end the one before; the server does not answer to it.

        Raises:
            MachineryError: If the server cannot be reached.
        """
        self._start_clock()
        self._instruction = instruction
        self._begin(lambda: self._start_episode(seed))

    def act(self, observation: Observation) -> Chunk:
        """The next actions (H, n); an answer with a single action is a chunk of one.

        Raises:
            PolicyError: If the policy fails, is too slow, or gives no chunk of actions.
            MachineryError: If the connection is lost, or what comes is no answer.
        """
        self._start_clock()
        if self._connection is None:
            raise MachineryError("The connection to the policy's server is lost.")
        request = self._layout.request(observation, self._instruction)
        with self._talking() as connection:
            seq = self._send(connection, "observation", request)
            answer = self._answer(connection, seq)
        actions = actions_of(answer, self._layout.actions.key)
        if dimensions(actions) == 1:
            actions = np.asarray(actions)[None]
        return self._layout.chunk(actions)[: self._server.execute]

    def close(self) -> None:
        """End the episode, and close the connection."""
        if self._connection is not None:
            with suppress(DuoBenchError), self._talking() as connection:
                self._end_episode(connection)
        self._drop()

    def _start_episode(self, seed: int) -> None:
        with self._talking() as connection:
            self._end_episode(connection)
            task = {"name": self._instruction, "seed": seed}
            self._start_seq = self._send(connection, "episode_start", {"task": task})
            self._is_playing = True

    def _end_episode(self, connection: ClientConnection) -> None:
        if self._is_playing:
            self._send(connection, "episode_end", {})
        self._is_playing = False

    def _drop(self) -> None:
        """End the connection; the server ends the episode on it."""
        super()._drop()
        self._is_playing = False

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

    def _answer(self, connection: ClientConnection, asked: int) -> dict[str, Any]:
        """What answers an observation, or what made the episode impossible to begin."""
        kind, payload, seq = self._receive(connection)
        if kind == "error" and seq in (asked, self._start_seq):
            raise reported(str(payload.get("error")))
        if kind not in ("action", "error"):
            raise MessageError(f"An observation is answered by an action, got {kind!r:.40}.")
        if seq != asked:
            raise MessageError(f"Message {asked} was answered, but the answer is to {seq!r:.40}.")
        return payload

    def _greet(self, connection: ClientConnection) -> None:
        """Say hello, and read what is served: the same as before, or another run begins."""
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
        if self._hello is not None and repr(hello) != repr(self._hello):
            raise MachineryError("The server has another policy now than when the run began.")
        self._hello = hello


def _described(hello: dict[str, Any], layout: Layout, execute: int | None) -> PolicyMetadata:
    """What a server's policy expects, as far as it tells.

    Raises:
        ServingError: If it describes itself wrongly, or otherwise than the layout.
    """
    try:
        declared = msgspec.convert(hello, Declared)
    except msgspec.ValidationError as error:
        raise ServingError(f"The server describes its policy wrongly: {error}.") from error
    if problems := list(contradictions(declared, layout)):
        raise ServingError(
            f"The server and the layout contradict each other: {'; '.join(problems)}. Use a layout "
            "that says what this server does, or a server that was made for this one."
        )
    name = printable(declared.model_server)[:_LONGEST_NAME] or LAYOUT
    harness = printable(declared.harness_version)[:_LONGEST_NAME] or "unknown"
    told = {key: hello.get(key) for key in ("observation_params", "action_spec")}
    digest = hashlib.sha256(repr((layout, told)).encode(errors="replace")).hexdigest()[:16]
    asked = "all" if execute is None else f"first {execute}"
    version = f"vla-eval {harness}, {name}, layout {digest}, {asked} actions of a chunk"
    return layout.metadata(name, version, seeded=False)
