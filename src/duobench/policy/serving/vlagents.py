"""A policy at a server of VLAgents 0.3, which shows observations to an agent and gives its actions.

There is one connection for all episodes: the server has no word for the start of an episode and
nothing that belongs to a connection, and it closes its agent whenever somebody leaves.
"""

from __future__ import annotations

import re
import time
from contextlib import AbstractContextManager, closing

from duobench.errors import MachineryError, MessageError, ServingError
from duobench.policy.batch import Batching, Chunk, Observation
from duobench.policy.protocol import PolicyMetadata
from duobench.policy.serving import limits
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.calls import CallConnection, CallError
from duobench.policy.serving.connection import ConnectedPolicy, reported
from duobench.policy.serving.layout import ActionLayout, Layout
from duobench.policy.serving.vlagents_messages import actions_from, observation_text

LAYOUT = "vlagents"
"""The layout of a server for which none is given."""
_PROMPT = "language_instruction"
_FIELD = re.compile(r"obs\.(left|right)\.(cameras\.\w+|joints|gripper|tquat)")
_LONGEST_NAME = 200
_LOADING_S = 1.0
"""Pause between looks whether an agent is loaded, in seconds."""


class VLAgentsPolicy(ConnectedPolicy[CallConnection]):
    """An agent at a server of VLAgents, as a policy.

    A layout for it has the fields of VLAgents' observations for keys; there are no keys to get in.
    """

    _usual_layout = LAYOUT

    def __init__(self, server: RemoteServer) -> None:
        """Connect, and wait until the agent is loaded."""
        if server.layout is not None:
            _check(server.layout)
        super().__init__(server)

    def _dial(self) -> AbstractContextManager[CallConnection]:
        parts = self._server.parts
        return closing(CallConnection(parts.hostname or "", parts.port or 0, self._left))

    def _greet(self, connection: CallConnection) -> tuple[PolicyMetadata, Batching | None]:
        try:
            agent = connection.call("name")
            if not isinstance(agent, str) or not agent.isprintable() or len(agent) > _LONGEST_NAME:
                raise MessageError("the name of its agent is no printable text.")
            if connection.has("reset"):
                raise ServingError(
                    "The server takes a `reset`, which VLAgents 0.3 does not know: it is of "
                    "another version, whose messages mean something else. Serve the agent with "
                    "vlagents 0.3."
                )
            while connection.call("is_initialized") is not True:
                self._wait(_LOADING_S, "its agent is still being loaded, or could not be")
        except (CallError, MessageError) as error:
            raise MachineryError(f"What answers is no server of VLAgents: {error}") from error
        return self._foreign_metadata(f"vlagents {agent}", agent, self._layout), None

    def _begin(self, connection: CallConnection, seed: int) -> None:  # noqa: ARG002 - it takes none
        """See whether the server is there; only observations tell it the instruction."""
        connection.call("is_initialized")

    def _ask(self, connection: CallConnection, observation: Observation) -> Chunk:
        message = self._layout.request(observation, self._instruction)
        for arm in message["obs"].values():
            if "gripper" in arm:
                arm["gripper"] = float(arm["gripper"][0])
        try:
            answer = connection.call("act", observation_text(message))
        except CallError as error:
            raise reported(str(error)) from error
        return self._layout.chunk(actions_from(answer))

    def _missing_sign(self) -> str | None:
        self._deadline = time.monotonic() + limits.HEALTH_S
        try:
            with self._dial() as connection:
                connection.call("is_initialized")
        except (OSError, EOFError, ServingError):
            return "answer anything else"
        return None


def _check(layout: Layout) -> None:
    wrong = [key for key in (*layout.images, *layout.state) if not _FIELD.fullmatch(key)]
    if wrong or layout.prompt != _PROMPT or not layout.state:
        raise ServingError(
            f"The keys of a layout for VLAgents are obs.ARM.joints, obs.ARM.gripper, "
            "obs.ARM.tquat and obs.ARM.cameras.NAME, with left or right for ARM, and its prompt is "
            f"{_PROMPT!r}; got {', '.join(wrong) or repr(layout.prompt)}. The layout {LAYOUT!r} is "
            "one of them."
        )
    if layout.actions != ActionLayout(mode=layout.actions.mode):
        raise ServingError(
            "VLAgents names the parts of an action; a layout for it says nothing of them but the "
            "mode."
        )
