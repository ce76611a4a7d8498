"""What an actor is on its node: it starts a process of the evaluation there, and passes messages.

The actor itself neither simulates nor holds a policy: these are in processes of their own, as they
are without Ray, which end with the actor, however it ends.
"""

from __future__ import annotations

import fcntl
import os
import select
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from duobench.errors import EvaluationError, RenderingError
from duobench.runners.child import Child, Refused
from duobench.runners.ray_cluster import AUTH_MODE, TOKEN, load
from duobench.versions import __version__

POLL_S = 0.5
"""How long an actor waits for messages before it tells how its process is, in seconds."""
DEATH_SEEN_S = 1.0
"""How long after a lost connection the end of a process may be seen, in seconds."""
PROGRESS = "Progress"
"""Tag of messages of that class, which is loaded where they are made."""
SECRETS = ("RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH")
"""What lets a process into the cluster, which a policy does not get."""


class _Worker(Child[msgspec.Raw]):
    module = "duobench.runners.worker"


class _Policy(Child[msgspec.Raw]):
    module = "duobench.runners.policy_process"


_KINDS: dict[str, type[_Worker | _Policy]] = {"worker": _Worker, "policy": _Policy}


class _Tagged(msgspec.Struct):
    type: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class News:
    """What an actor tells about its process."""

    messages: tuple[bytes, ...]
    """What the process has said, each a JSON text."""
    episode_s: float
    """Seconds since its episode began, 0 between episodes."""
    answer_s: float
    """Seconds since its policy was called, 0 while that is not busy."""
    steps: int
    """Control steps that the episode had then."""
    node: str
    """Id of the node."""
    host: str
    """Address of the node."""
    death: str | None
    """How the process ended, in words; None while it lives."""


class Host:
    """One process of an evaluation, beside which it lives as an actor."""

    def __init__(self, kind: str, version: str, renderers: int = 0) -> None:
        """Start the process.

        Args:
            kind: `worker` or `policy`.
            version: DuoBench's version where the run is written.
            renderers: How many processes may render on a node; 0 if nothing is rendered.
        """
        ray = load()
        self._node = ray.get_runtime_context().get_node_id()
        self._host = ray.util.get_node_ip_address()
        self._child: Child[msgspec.Raw] | None = None
        self._said: list[bytes] = []
        self._reading = threading.Lock()
        if reason := _objection(version):
            self._refuse(reason)
            return
        if renderers:
            with suppress(RenderingError, OSError):  # who needs images complains
                choose_once(self._node, renderers)
        self._child = _KINDS[kind](msgspec.Raw, hidden=SECRETS)

    def send(self, message: bytes) -> None:
        """Pass a message on to the process."""
        if self._child is not None:
            with suppress(OSError):
                self._child.channel.socket.sendall(message + b"\n")

    def poll(self) -> News:
        """Wait for messages, a moment at most, and tell how the process is.

        How far an episode is, which nobody waits for, is told with the next other message.
        """
        with self._reading:
            child = self._child
            death = "it was never started." if child is None else self._read(child)
            said, self._said = self._said, []
            return self._news(said, child, death)

    def _read(self, child: Child[msgspec.Raw]) -> str | None:
        """Take what a process says, for a moment at most; how it ended, if it did."""
        sockets = [child.channel.socket]
        until = time.monotonic() + POLL_S
        try:
            while all(map(_may_wait, self._said)) and (left := until - time.monotonic()) > 0:
                if select.select(sockets, [], [], left)[0]:
                    self._said += [bytes(message) for message in child.receive()]
            death = None if self._said else child.death()
            while select.select(sockets, [], [], 0)[0]:
                self._said += [bytes(message) for message in child.receive()]
        except EOFError:
            return child.death_within(DEATH_SEEN_S) or "its process closed the connection."
        except Exception as error:  # noqa: BLE001 - a process boundary: it is told
            return f"its result cannot be read ({error})."
        return death

    def _news(self, said: list[bytes], child: Child[Any] | None, death: str | None) -> News:
        clock = child and child.clock
        return News(
            messages=tuple(said),
            episode_s=clock.episode_s() if clock else 0.0,
            answer_s=clock.answer_s() if clock else 0.0,
            steps=clock.steps if clock else 0,
            node=self._node,
            host=self._host,
            death=death,
        )

    def _refuse(self, reason: str) -> None:
        refused = Refused(error=EvaluationError.__name__, message=reason)
        self._said.append(msgspec.json.encode(refused))


def _may_wait(message: bytes) -> bool:
    """Whether a message of a process says how far it is, and nothing that is waited for."""
    return msgspec.json.decode(message, type=_Tagged).type == PROGRESS


def _objection(version: str) -> str:
    """Why nothing is played on this node; empty if it is as it must be."""
    mode = os.environ.get(AUTH_MODE, "").strip().lower()
    if mode != TOKEN:
        return (
            f"A node of the cluster was started with {AUTH_MODE}={mode or '(nothing)'}, so that "
            f"anybody who reaches it can run code on it. Start every node with {AUTH_MODE}={TOKEN}."
        )
    if version != __version__:
        return (
            f"A node of the cluster has DuoBench {__version__}, where the run is written it is "
            f"{version}. Install the same everywhere."
        )
    return ""


def choose_once(node: str, renderers: int) -> str:
    """Choose how to render, once a node: later processes take the choice of the first.

    Args:
        node: Id of the node.
        renderers: How many processes may render on it.

    Returns:
        The choice, which is also in the environment of this process.

    Raises:
        RenderingError: Nothing renders.
        OSError: The choice cannot be kept.
    """
    from duobench.sim.probe import BACKENDS, CHOSEN, choose

    folder = Path(tempfile.gettempdir(), f"duobench-{os.getuid()}")
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.is_symlink() or folder.stat().st_uid != os.getuid():
        raise PermissionError(f"{folder} is somebody else's.")
    path = folder / f"rendering-{node}"
    with path.open("a+", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)  # until the first has chosen; closing frees it
        file.seek(0)
        if (known := file.read().strip()) in BACKENDS:
            os.environ[CHOSEN] = known
            return known
        backend = choose(processes=renderers)
        file.truncate(0)
        file.write(backend)
        return backend
