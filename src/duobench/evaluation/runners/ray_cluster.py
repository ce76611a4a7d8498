"""Processes of an evaluation on the nodes of a Ray cluster, under the rules of one machine.

Each is beside an actor. One that is lost, with its actor or its whole node, loses only what it was
playing, which is played again. No disk is shared.
"""

import importlib.util
import logging
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import msgspec

from duobench.core.errors import (
    DuoBenchError,
    EvaluationError,
    MachineryError,
    MessageError,
    escaped,
)
from duobench.core.machine import install_extra
from duobench.core.versions import __version__
from duobench.evaluation.clock import ClockReading
from duobench.evaluation.episode import Job
from duobench.evaluation.runners.policy_process import Answering
from duobench.evaluation.runners.pool import MAX_FAILED_STARTS, POLICY, WORKER
from duobench.evaluation.runners.process import ProcessFailed, Transport
from duobench.evaluation.runners.ray_process import (
    AUTH_MODE,
    TOKEN,
    ActorStatus,
    Cluster,
    RemoteProcess,
    auth_mode,
    load,
)
from duobench.evaluation.runners.worker import Report

_log = logging.getLogger(__name__)

_SIDE_BY_SIDE = 4
"""Calls that an actor answers at the same time: one waits for messages, others pass some on."""
_NO_STATISTICS = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_USAGE_STATS_PROMPT_ENABLED": "0"}


def check_environment() -> None:
    """Reject an environment without Ray, or without a token."""
    if importlib.util.find_spec("ray") is None:
        raise EvaluationError(f"Ray is not installed. {install_extra('ray')}")
    mode = auth_mode()
    if mode != TOKEN:
        raise EvaluationError(
            f"{AUTH_MODE} is {mode or 'not set'}. A cluster without a token lets everyone who "
            f"reaches it run code on it, and Ray listens at all interfaces: start every node, and "
            f"this command, with {AUTH_MODE}={TOKEN} and the same RAY_AUTH_TOKEN."
        )


class RayLauncher:
    """Starts processes on the nodes of a cluster; this process alone writes.

    Args:
        cluster: The cluster.
        job: What is played.
        workers: Most workers, of which all may be on one node.
    """

    def __init__(
        self,
        cluster: Cluster,
        job: Job,
        workers: int,
    ) -> None:
        self._cluster = cluster
        self._renderers = workers if job.videos or job.policy.kind.may_see else 0
        self._is_connected = False
        # A node that is lost while its workers start takes all of them with it.
        self.max_failed_starts = MAX_FAILED_STARTS + workers

    def open(self) -> None:
        """Connect this process to the cluster, unless it is connected already."""
        check_environment()
        os.environ.update(_NO_STATISTICS)
        ray = load()
        if not ray.is_initialized():
            self._connect(ray)
        lacking = self._lacking(ray)
        if lacking:
            _log.warning("No node of the cluster has %s yet; waiting for one.", lacking)

    def _connect(self, ray: Any) -> None:
        try:
            ray.init(
                address=self._cluster.address,
                log_to_driver=False,
                configure_logging=False,
            )
        except (ray.exceptions.RayError, OSError, RuntimeError, ValueError) as error:
            raise MachineryError(
                f"The Ray cluster at {self._cluster.address} cannot be used from here: "
                f"{' '.join(str(error).split())} This machine must be a node of it, with the same "
                "version of Ray and the same token."
            ) from error
        self._is_connected = True

    def _lacking(self, ray: Any) -> str:
        """Return resources that no node of the cluster has now, in words; empty if none lack."""
        gpus = self._cluster.policy_gpus
        nodes: list[dict[str, Any]] = [
            node["Resources"] for node in ray.nodes() if node["Alive"]
        ]
        if not any(node.get("CPU", 0) >= 1 for node in nodes):
            return "a processor core for a simulator"
        if gpus and not any(node.get("GPU", 0) >= gpus for node in nodes):
            return f"{gpus:g} graphics cards for a policy"
        return ""

    def start_policy(self) -> Transport:
        """Start an actor with a process that makes a policy."""
        # It thinks while its simulators wait, so that it needs no core of its own.
        actor = _actor(
            num_cpus=0, num_gpus=self._cluster.policy_gpus, scheduling_strategy="SPREAD"
        )
        return RayTransport(
            actor.remote(POLICY, __version__, is_reached=True),
            Answering | ProcessFailed,
        )

    def start_worker(self, policy: Transport | None) -> Transport:
        """Start an actor with a worker, which is best on the node of a policy for itself."""
        near: Any = "SPREAD"
        if isinstance(policy, RayTransport) and policy.node is not None:
            strategies = load("ray.util.scheduling_strategies")
            near = strategies.NodeAffinitySchedulingStrategy(policy.node, soft=True)
        actor = _actor(num_cpus=1, scheduling_strategy=near)
        return RayTransport(
            actor.remote(WORKER, __version__, renderers=self._renderers), Report
        )

    def wait(self, processes: Sequence[Any], seconds: float) -> Sequence[Any]:
        """Wait until processes have said something, or the time is over; those that have."""
        if not any(process.has_said for process in processes):
            expected = [process.status for process in processes]
            if expected:
                load().wait(expected, timeout=seconds)
            else:
                time.sleep(seconds)
        for process in processes:
            process.death()
        return [process for process in processes if process.has_said]

    def close(self) -> None:
        """End the connection, and with it every actor."""
        if self._is_connected:
            load().shutdown()
            self._is_connected = False


class RayTransport:
    """A process beside an actor, which starts it once there is room; it dies with the actor."""

    def __init__(self, actor: Any, kind: Any) -> None:
        self._actor = actor
        self._decoder = msgspec.json.Decoder(kind)
        self._messages: list[Any] = []
        self._unreadable: str | None = None
        self._death: str | None = None
        self._clock = ClockReading()
        self.is_taken = False
        """Whether the actor has ended, and the process with it."""
        self.node: str | None = None
        """Id of the node, once the actor is there."""
        self.status = actor.poll.remote()
        """Next message of the actor, still to come."""

    @property
    def has_said(self) -> bool:
        """Whether there is something to receive."""
        return bool(self._messages or self._unreadable or self._death)

    def send(self, request: msgspec.Struct) -> None:
        """Send a request."""
        self._actor.send.remote(msgspec.json.encode(request))

    def death(self) -> str | None:
        """End of the process in words, after the actor's messages have been taken."""
        ray = load()
        if self._death is not None or not ray.wait([self.status], timeout=0)[0]:
            return self._death
        try:
            status: ActorStatus = ray.get(self.status)
        except ray.exceptions.RayError as error:
            self._death, self.is_taken = f"its actor ended: {_first_line(error)}", True
            return self._death
        self.node = status.node
        self._clock = status.clock
        self._death = status.death
        try:
            self._messages += [
                self._decoder.decode(message) for message in status.messages
            ]
        except (msgspec.MsgspecError, DuoBenchError) as error:
            self._unreadable = str(error)
        if self._death is None:
            self.status = self._actor.poll.remote()
        return self._death

    def receive(self) -> list[Any]:
        """Return the messages of the process; see `Transport`."""
        death = self.death()
        said, self._messages = self._messages, []
        if not said and self._unreadable is not None:
            raise MessageError(self._unreadable)
        if not said and death is not None:
            raise EOFError
        return said

    def clock(self) -> ClockReading:
        """Return the last reading from the actor; time that has passed since is not guessed."""
        return self._clock

    def kill(self) -> None:
        """End the actor, and with it the process and all that this has started."""
        ray = load()
        with suppress(ray.exceptions.RayError, ValueError):
            ray.kill(self._actor)


def _actor(**options: Any) -> Any:
    options |= {
        "max_concurrency": _SIDE_BY_SIDE,
        "max_restarts": 0,
        "max_task_retries": 0,
    }
    return load().remote(RemoteProcess).options(**options)


def _first_line(error: BaseException) -> str:
    lines = [line.strip() for line in escaped(str(error)).splitlines()]
    cause = next(
        (
            line
            for line in reversed(lines)
            if line.endswith("Error") or "Error:" in line
        ),
        "",
    )
    return cause or next(filter(None, lines), type(error).__name__)
