"""Actor on its node: it starts a process of the evaluation there, and passes messages.

The actor itself neither simulates nor holds a policy: these are in processes of their own, as they
are without Ray, which end with the actor, however it ends.
"""

import fcntl
import os
import select
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec

from duobench.core.errors import EvaluationError, RenderingError
from duobench.core.versions import __version__
from duobench.evaluation.clock import ClockReading
from duobench.evaluation.runners.process import (
    DEATH_SEEN_S,
    POLICY_BYTES,
    RESULT_BYTES,
    ProcessFailed,
    WorkerProcess,
    death_within,
)

AUTH_MODE, TOKEN = "RAY_AUTH_MODE", "token"
"""Environment variable of Ray, and the value that keeps out clients without the cluster's token."""
POLL_S = 0.5
"""Seconds that an actor waits for messages before it reports on its process."""
PROGRESS = b'{"type":"EpisodeProgress"'
"""Beginning of the messages of that class, which is loaded where they are made."""
SECRETS = ("RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH")
"""Variables that let a process into the cluster, which a policy does not get."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Cluster:
    """A Ray cluster that is there, and what of it is used."""

    address: str = "auto"
    """HOST:PORT of its head, or `auto` for the one that runs on this machine."""
    policy_gpus: float = 0.0
    """Graphics cards that each actor of a policy asks for; a part of one, or several."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.policy_gpus < float("inf"):
            raise EvaluationError(
                f"A number of graphics cards is 0 or more: {self.policy_gpus}."
            )
        if self.address.startswith("ray://") or not self.address.strip():
            raise EvaluationError(
                f"{self.address!r} is no address of a cluster: give HOST:PORT of its head, or "
                "auto, on a machine that is a node of the cluster."
            )


def load(module: str = "ray") -> Any:
    """A module of the library, which takes seconds to load."""
    return import_module(module)


def auth_mode() -> str:
    """Authentication of this process at a cluster; empty if none is set."""
    return os.environ.get(AUTH_MODE, "").strip().lower()


@dataclass(frozen=True, kw_only=True, slots=True)
class ActorStatus:
    """Status of an actor's process."""

    messages: tuple[bytes, ...]
    """Messages of the process, each a JSON text."""
    clock: ClockReading
    node: str
    death: str | None


class RemoteProcess:
    """One process of an evaluation, beside which it lives as an actor.

    Args:
        module: What the process runs; see `WorkerProcess`.
        version: DuoBench's version where the run is written.
        is_reached: Whether processes on other nodes connect to it, as they do to a policy.
        renderers: How many processes may render on a node; 0 if nothing is rendered.
    """

    def __init__(
        self, module: str, version: str, *, is_reached: bool = False, renderers: int = 0
    ) -> None:
        ray = load()
        self._node = ray.get_runtime_context().get_node_id()
        self._process: WorkerProcess | None = None
        self._said: list[bytes] = []
        self._most = POLICY_BYTES if is_reached else RESULT_BYTES
        self._reading = threading.Lock()
        reason = _objection(version)
        if reason:
            self._said = [
                msgspec.json.encode(ProcessFailed(EvaluationError.__name__, reason))
            ]
            return
        if renderers:
            with suppress(RenderingError, OSError):  # who needs images complains
                choose_once(self._node, renderers)
        host = (ray.util.get_node_ip_address(),) if is_reached else ()
        self._process = WorkerProcess(
            module, msgspec.Raw, *host, hidden=SECRETS, most=self._most
        )

    def send(self, message: bytes) -> None:
        """Pass a message on to the process."""
        if self._process is not None:
            self._process.send(msgspec.Raw(message))

    def poll(self) -> ActorStatus:
        """Wait for messages, a moment at most, and tell how the process is.

        The progress of an episode is not urgent: it is sent with the next other message.
        """
        with self._reading:
            death, clock = "it was never started.", ClockReading()
            if self._process is not None:
                death, clock = self._read(self._process), self._process.clock()
            said, self._said = self._said, []
            return ActorStatus(
                messages=tuple(said), clock=clock, node=self._node, death=death
            )

    def _read(self, process: WorkerProcess) -> str | None:
        """Take what a process says, for a moment at most; how it ended, if it did."""
        until = time.monotonic() + POLL_S
        try:
            while self._may_wait() and (left := until - time.monotonic()) > 0:
                if select.select([process], [], [], left)[0]:
                    self._said += map(bytes, process.receive())
            death = None if self._said else process.death()
            while self._has_room() and select.select([process], [], [], 0)[0]:
                self._said += map(bytes, process.receive())
        except EOFError:
            return (
                death_within(process, DEATH_SEEN_S)
                or "its process closed the connection."
            )
        except Exception as error:  # noqa: BLE001 - a process boundary: it is told
            return f"what it sent cannot be read ({error})."
        return death

    def _may_wait(self) -> bool:
        return self._has_room() and all(map(_may_wait, self._said))

    def _has_room(self) -> bool:
        """Whether more may be read before what was said is passed on."""
        return sum(map(len, self._said)) <= self._most


def _may_wait(message: bytes) -> bool:
    """Whether a message of a process says how far it is, and nothing that is waited for."""
    return message.startswith(PROGRESS)


def _objection(version: str) -> str:
    """Reason why this node cannot play; empty if it can."""
    mode = auth_mode()
    if mode != TOKEN:
        return (
            f"A node of the cluster was started with {AUTH_MODE}={mode or '(nothing)'}, so that "
            f"everyone who reaches it can run code on it. Start all nodes with {AUTH_MODE}={TOKEN}."
        )
    if version != __version__:
        return (
            f"A node of the cluster has DuoBench {__version__}, where the run is written it is "
            f"{version}. Install the same everywhere."
        )
    return ""


def choose_once(node: str, renderers: int) -> str:
    """Choose how to render, once a node: later processes take the choice of the first.

    It is put into the environment of this process, which is one of so many renderers there.
    """
    from duobench.world.sim.opengl import BACKENDS, CHOSEN, choose

    folder = Path(tempfile.gettempdir(), f"duobench-{os.getuid()}")
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.is_symlink() or folder.stat().st_uid != os.getuid():
        raise PermissionError(f"{folder} belongs to another user.")
    path = folder / f"rendering-{node}"
    with path.open("a+", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)  # until the first has chosen; closing frees it
        file.seek(0)
        known = file.read().strip()
        if known in BACKENDS:
            os.environ[CHOSEN] = known
            return known
        backend = choose(processes=renderers)
        file.truncate(0)
        file.write(backend)
        return backend
