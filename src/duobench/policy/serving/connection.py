"""A policy at a server, whatever is said on the connection to it.

What the server's policy does wrong is a `PolicyError`, which fails an episode. What happens to the
connection is a `MachineryError`, after which an episode can be played again from its start. Nothing
is read from a connection after an answer that did not come in time: it would be the late one.
"""

from __future__ import annotations

import hashlib
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import ClassVar, Generic, TypeVar

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
from duobench.policy.protocol import PolicyMetadata
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.layout import Layout, read_layout

C = TypeVar("C")

_RETRY_S = 0.2
"""Pause between attempts to connect, in seconds."""


class ConnectedPolicy(ABC, Generic[C]):
    """A policy at a server; a subclass knows how that is reached, and what is said there."""

    metadata: PolicyMetadata
    """What the policy expects of the environment."""
    batching: Batching | None
    """How many observations the server answers together, if it tells."""
    _usual_layout: ClassVar[str | None] = None
    """Name of the layout of a server for which none is given; None takes openpi's keys."""
    _breaks: ClassVar[tuple[type[Exception], ...]] = (OSError, EOFError)
    """What is raised where there is no connection, or no more."""

    def __init__(self, server: RemoteServer) -> None:
        """Connect, and learn what is served.

        Args:
            server: Where the policy is served.

        Raises:
            ServingError: If the server asks for another key, cannot be understood, or contradicts
                the layout.
            MachineryError: If there is no server of this kind.
        """
        self._server = server
        usual = self._usual_layout
        self._layout = server.layout or (Layout() if usual is None else read_layout(usual))
        self._ending = ExitStack()
        self._connection: C | None = None
        self._served: tuple[PolicyMetadata, Batching | None] | None = None
        self._instruction = ""
        self._give_up = 0.0
        self._deadline = time.monotonic() + server.wait_s + server.answer_s
        self._connect()

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode, once more if the connection was lost while nobody asked.

        Raises:
            PolicyError: If the policy fails, or is too slow.
            MachineryError: If the server cannot be reached.
        """
        self._deadline = time.monotonic() + self._server.answer_s
        self._instruction = instruction
        is_fresh = self._connection is None
        try:
            self._start(seed)
        except MachineryError:
            if is_fresh:
                raise
            self._start(seed)

    def act(self, observation: Observation) -> Chunk:
        """The next actions (H, n).

        Raises:
            PolicyError: If the policy fails, is too slow, or gives no chunk of actions.
            MachineryError: If the connection is lost, or what comes cannot be read.
        """
        self._deadline = time.monotonic() + self._server.answer_s
        if self._connection is None:
            raise MachineryError("The connection to the policy's server is lost.")
        with self._talking() as connection:
            return self._ask(connection, observation)[: self._server.execute]

    def close(self) -> None:
        """Close the connection."""
        self._drop()

    @abstractmethod
    def _dial(self) -> AbstractContextManager[C]:
        """Connect once; errors are `_breaks`, or those of `_greet`."""

    @abstractmethod
    def _greet(self, connection: C) -> tuple[PolicyMetadata, Batching | None]:
        """Say and read what comes first on every connection.

        Returns:
            What the policy expects, and how many observations are answered together, if known.

        Raises:
            ServingError: If the server speaks otherwise, or contradicts the layout.
            MachineryError: If what answers is no such server.
        """

    @abstractmethod
    def _begin(self, connection: C, seed: int) -> None:
        """Say that an episode begins."""

    @abstractmethod
    def _ask(self, connection: C, observation: Observation) -> Chunk:
        """The server's chunk for an observation, after whose errors the connection can be used."""

    @abstractmethod
    def _missing_sign(self) -> str | None:
        """What a server that lives would do, and this one does not; None if it lives."""

    def _foreign_metadata(
        self, name: str, version: str, facts: object, *, seeded: bool = False
    ) -> PolicyMetadata:
        """What a policy of others expects; its version also says in which layout."""
        digest = hashlib.sha256(repr(facts).encode(errors="replace")).hexdigest()[:16]
        version = f"{version}, layout {digest}, {self._server.executed}"
        return self._layout.metadata(name, version, seeded=seeded)

    def _start(self, seed: int) -> None:
        with self._talking() as connection:
            self._begin(connection, seed)

    def _left(self) -> float:
        """Seconds that the answer may still take."""
        return max(self._deadline - time.monotonic(), 0.0)

    def _late(self) -> DuoBenchError:
        """Whose fault it is that there was no answer: a server that still lives has waited too."""
        late = f"did not answer within {self._server.answer_s:g} s"
        if missing := self._missing_sign():
            return MachineryError(f"The policy's server {late}, nor does it {missing}.")
        return PolicyTimeoutError(f"The policy's server lives, but {late}.")

    @contextmanager
    def _talking(self) -> Iterator[C]:
        """The connection, made if there is none; all but a policy's own errors end it."""
        try:
            yield self._connection or self._connect()
        except PolicyError:
            raise
        except BaseException as error:
            self._drop()
            if isinstance(error, TimeoutError):
                raise self._late() from error
            if isinstance(error, self._breaks):
                raise MachineryError(
                    f"The connection to the policy's server is lost: {printable(str(error))}."
                ) from error
            if isinstance(error, MessageError):
                raise MachineryError(
                    f"The policy's server cannot be understood: {error}"
                ) from error
            raise

    def _connect(self) -> C:
        """Connect, and wait for a server that is not there."""
        self._give_up = min(self._deadline, time.monotonic() + self._server.wait_s)
        while True:
            try:
                connection = self._ending.enter_context(self._dial())
                self._recognize(connection)
            except self._breaks as error:
                self._drop()
                self._wait(_RETRY_S, str(error) or type(error).__name__)
            except BaseException:
                self._drop()
                raise
            else:
                self._connection = connection
                return connection

    def _recognize(self, connection: C) -> None:
        """Learn what is served: the same as before, or another run begins."""
        try:
            served = self._greet(connection)
        except ServingError:
            if self._served is None:
                raise
            served = None
        if served is None or self._served not in (None, served):
            raise MachineryError("The server has another policy now than when the run began.")
        self._served = served
        self.metadata, self.batching = served

    def _wait(self, pause_s: float, fault: str) -> None:
        """Wait before the next attempt.

        Raises:
            MachineryError: If there is no time for one; it says what was wrong with the last.
        """
        if time.monotonic() + pause_s >= self._give_up:
            raise MachineryError(f"The policy's server cannot be reached: {printable(fault)}.")
        time.sleep(pause_s)

    def _drop(self) -> None:
        """End the connection, without a word."""
        self._connection = None
        self._ending.close()


def reported(words: str) -> PolicyError:
    """The error of a policy whose server says in words what went wrong."""
    return PolicyError(f"The policy's server reports:\n{printable(words)[-LONGEST_TEXT:].strip()}")
