"""What a worker and its parent say to each other."""

from __future__ import annotations

import socket
from typing import Generic, TypeVar

import msgspec

from duobench.errors import DuoBenchError, MessageError
from duobench.evaluation.episode import EpisodeResult, Job
from duobench.policy.serving.address import RemoteServer
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import Episode

T = TypeVar("T")

_PIECE = 1 << 20
"""Bytes that are read at a time."""


class Play(msgspec.Struct, tag=True, frozen=True):
    """To a worker: play an episode."""

    episode: Episode


class Stop(msgspec.Struct, tag=True, frozen=True):
    """To a worker: free everything and leave."""


class Ready(msgspec.Struct, tag=True, frozen=True):
    """From a worker: the policy is made."""

    run: Run
    """What is played, and by what."""
    versions: dict[str, str | None]
    """Versions of everything that a result may depend on."""


class StartHost(msgspec.Struct, tag=True, frozen=True):
    """From a worker: the policy answers many episodes; this worker serves it, and plays none."""

    server: RemoteServer


class Progress(msgspec.Struct, tag=True, frozen=True):
    """From a worker: the episode has begun, or reached a new stage."""

    record: EpisodeRecord
    """Its record so far."""


class EpisodeError(msgspec.Struct, tag=True, frozen=True):
    """From a worker: the machinery failed, and the episode is unplayed; play it again."""

    fault: str


class Refused(msgspec.Struct, tag=True, frozen=True):
    """From a worker: what the run needs cannot be done by any worker."""

    error: str
    """Name of the class of the error."""
    message: str


Request = Job | Play | Stop
"""To a worker; a job comes first, which has it make the policy."""
Report = Ready | StartHost | Progress | EpisodeResult | EpisodeError | Refused
"""From a worker."""


class Channel(Generic[T]):
    """One end of a connection, on which every message is a line of JSON."""

    def __init__(self, connection: socket.socket, kind: type[T]) -> None:
        """Take a connected socket.

        Args:
            connection: The socket, which belongs to the channel from now on.
            kind: Type of the messages that are received, or a union of such types.
        """
        self.socket = connection
        """The socket, to wait for, and to close."""
        self._decoder = msgspec.json.Decoder(kind)
        self._rest = bytearray()

    def send(self, message: Request | Report) -> None:
        """Send a message.

        Raises:
            OSError: The other end is closed.
        """
        self.socket.sendall(msgspec.json.encode(message) + b"\n")

    def receive(self) -> list[T]:
        """Read what has arrived; the messages that are complete.

        It waits only if nothing has arrived: an end of the channel that dies in the middle of a
        message leaves it incomplete, also while a child of it keeps the channel open.

        Raises:
            EOFError: The other end is closed.
            MessageError: A message is none of the expected kind.
        """
        try:
            piece = self.socket.recv(_PIECE)
        except ConnectionError:
            piece = b""
        if not piece:
            raise EOFError
        self._rest += piece
        if b"\n" not in piece:  # of a long message, such as one with a video
            return []
        *lines, self._rest = self._rest.split(b"\n")
        try:
            return [self._decoder.decode(line) for line in lines]
        except (msgspec.MsgspecError, DuoBenchError) as error:
            raise MessageError(str(error)) from error
