"""A policy at a server of VLAgents 0.3, which shows observations to an agent and gives its actions.

What the agent does wrong is a `PolicyError`, which fails an episode. What happens to the connection
is a `MachineryError`, after which an episode can be played again from its start. Nothing is read
from a connection after an answer that did not come in time.

There is one connection for all episodes: the server has no word for the start of an episode and
nothing that belongs to a connection, and it closes its agent whenever somebody leaves.
"""

from __future__ import annotations

import hashlib
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager

from duobench.errors import (
    DuoBenchError,
    MachineryError,
    MessageError,
    PolicyError,
    PolicyTimeoutError,
    ServingError,
)
from duobench.policy.batch import Batching, Chunk, Observation
from duobench.policy.serving import limits
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.calls import CallConnection, CallError
from duobench.policy.serving.layout import ActionLayout, Layout, read_layout
from duobench.policy.serving.vlagents_messages import actions_from, observation_text

LAYOUT = "vlagents"
"""The layout of a server for which none is given."""
_PROMPT = "language_instruction"
_FIELD = re.compile(r"obs\.(left|right)\.(cameras\.\w+|joints|gripper|tquat)")
_LONGEST_NAME = 200
_RETRY_S = 0.2
"""Pause between attempts to connect, in seconds."""
_LOADING_S = 1.0
"""Pause between looks whether an agent is loaded, in seconds."""


class VLAgentsPolicy:
    """An agent at a server of VLAgents, as a policy."""

    def __init__(self, server: RemoteServer) -> None:
        """Connect, and wait until the agent is loaded.

        Args:
            server: Where it is served. A layout has the fields of VLAgents' observations for keys;
                there are no keys to get in.

        Raises:
            ServingError: If the layout is one for other servers, or the server is of another
                version.
            MachineryError: If there is no server, or its agent is not loaded in time.
        """
        self._layout = server.layout or read_layout(LAYOUT)
        _check(self._layout)
        self._server = server
        self._connection: CallConnection | None = None
        self._agent: str | None = None
        self._instruction = ""
        self._deadline = time.monotonic() + server.wait_s + server.answer_s
        self._connect()
        described = hashlib.sha256(repr(self._layout).encode()).hexdigest()[:16]
        executed = "all" if server.execute is None else f"first {server.execute}"
        self.metadata = self._layout.metadata(
            f"vlagents {self._agent}",
            f"{self._agent}, layout {described}, {executed} actions of a chunk",
            seeded=False,
        )
        """What the policy expects of the environment."""
        self.batching: Batching | None = None
        """Nobody knows how many observations the agent answers together."""

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - the server takes none
        """Begin an episode; the server is told nothing but the instruction in every observation.

        Raises:
            MachineryError: If the server cannot be reached.
        """
        self._instruction = instruction
        self._deadline = time.monotonic() + self._server.answer_s
        try:
            self._call("is_initialized")
        except MachineryError:  # perhaps lost while nobody asked; the episode has not begun
            self._connect()

    def act(self, observation: Observation) -> Chunk:
        """The next actions (H, n).

        Raises:
            PolicyError: If the agent fails, is too slow, or gives no chunk of actions.
            MachineryError: If the connection is lost, or what comes cannot be read.
        """
        self._deadline = time.monotonic() + self._server.answer_s
        message = self._layout.request(observation, self._instruction)
        for arm in message["obs"].values():
            if "gripper" in arm:
                arm["gripper"] = float(arm["gripper"][0])
        answer = self._call("act", observation_text(message))
        with self._understanding():
            actions = actions_from(answer)
        return self._layout.chunk(actions)[: self._server.execute]

    def close(self) -> None:
        """Close the connection."""
        if self._connection is not None:
            self._connection.close()
        self._connection = None

    def _call(self, name: str, *arguments: str) -> object:
        """Call a method of the server."""
        if self._connection is None:
            raise MachineryError("The connection to the policy's server is lost.")
        with self._understanding():
            return self._connection.call(name, *arguments, deadline=self._deadline)

    @contextmanager
    def _understanding(self) -> Iterator[None]:
        """Say whose fault it is if something goes wrong; after most faults, nothing more comes."""
        try:
            yield
        except PolicyError:
            raise
        except CallError as error:
            raise PolicyError(f"The policy's server reports:\n{error}") from error
        except TimeoutError as error:
            self.close()
            raise self._late() from error
        except (OSError, EOFError) as error:
            self.close()
            raise MachineryError(
                f"The connection to the policy's server is lost: {error}."
            ) from error
        except MessageError as error:
            self.close()
            raise MachineryError(f"The policy's server cannot be understood: {error}") from error
        except BaseException:  # such as an interrupt, in the middle of a message
            self.close()
            raise

    def _late(self) -> DuoBenchError:
        """Whose fault it is that there was no answer: a server that still lives has waited too."""
        late = f"did not answer within {self._server.answer_s:g} s"
        deadline = time.monotonic() + limits.HEALTH_S
        try:
            connection = self._dial(deadline)
            try:
                connection.call("is_initialized", deadline=deadline)
            finally:
                connection.close()
        except (OSError, EOFError, ServingError):
            return MachineryError(f"The policy's server {late}, nor does it answer anything else.")
        return PolicyTimeoutError(f"The policy's server lives, but {late}.")

    def _connect(self) -> None:
        """Connect, and wait for a server that is not there, or still loads its agent."""
        self.close()
        give_up = min(self._deadline, time.monotonic() + self._server.wait_s)
        while True:
            pause = _RETRY_S
            try:
                if self._connection is None:
                    self._connection = self._dial(self._deadline)
                    self._check_server(self._connection)
                if self._connection.call("is_initialized", deadline=self._deadline) is True:
                    return
                fault, pause = "its agent is still being loaded, or could not be", _LOADING_S
            except (OSError, EOFError) as error:
                fault = str(error) or type(error).__name__
                self.close()
            except (CallError, MessageError) as error:
                self.close()
                raise MachineryError(f"What answers is no server of VLAgents: {error}") from error
            except BaseException:
                self.close()
                raise
            if time.monotonic() + pause >= give_up:
                self.close()
                raise MachineryError(f"The policy's server cannot be reached: {fault}.")
            time.sleep(pause)

    def _dial(self, deadline: float) -> CallConnection:
        parts = self._server.parts
        return CallConnection(parts.hostname or "", parts.port or 0, deadline)

    def _check_server(self, connection: CallConnection) -> None:
        """Reject a server of another version, and another agent than before."""
        name = connection.call("name", deadline=self._deadline)
        if not isinstance(name, str) or not name.isprintable() or len(name) > _LONGEST_NAME:
            raise MessageError("the name of its agent is no printable text.")
        if connection.has("reset", deadline=self._deadline):
            raise ServingError(
                "The server takes a `reset`, which VLAgents 0.3 does not know: it is of another "
                "version, whose messages mean something else. Serve the agent with vlagents 0.3."
            )
        if self._agent not in (None, name):
            raise MachineryError("The server has another policy now than when the run began.")
        self._agent = name


def _check(layout: Layout) -> None:
    """Reject a layout for other servers."""
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
