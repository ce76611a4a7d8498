"""Processes of an evaluation on other nodes, as the executor sees them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any

import msgspec
from msgspec.structs import replace as replace_field

from duobench.errors import DuoBenchError, MessageError, escaped
from duobench.evaluation.clock import EpisodeClock
from duobench.evaluation.episode import Job
from duobench.policy.registry import PolicyKind
from duobench.runners.child import Child, T
from duobench.runners.messages import Report
from duobench.runners.policy_process import MakePolicy, PolicyProcess
from duobench.runners.ray_cluster import Cluster
from duobench.runners.ray_host import Host, News
from duobench.runners.team import Team
from duobench.runners.worker import Worker
from duobench.versions import __version__

ray: Any = import_module("ray")
scheduling: Any = import_module("ray.util.scheduling_strategies")

Launch = Callable[[], Any]
"""Makes an actor of the class `Host`."""
_SIDE_BY_SIDE = 4
"""Calls that an actor answers at the same time: one waits for messages, others pass some on."""
_MAY_SEE = (PolicyKind.LEROBOT, PolicyKind.MODULE, PolicyKind.SERVED)


class RemoteClock(EpisodeClock):
    """What an actor has last said of a clock; time that has passed since then is not guessed."""

    def __init__(self) -> None:
        super().__init__()
        self._last: News | None = None

    def note(self, news: News) -> None:
        """Take what the actor says."""
        self._last = news

    def episode_s(self) -> float:
        """Seconds since the episode began, 0 between episodes."""
        return self._last.episode_s if self._last else 0.0

    def answer_s(self) -> float:
        """Seconds since the policy was called, 0 while it is not busy."""
        return self._last.answer_s if self._last else 0.0

    @property
    def steps(self) -> int:
        """Control steps that the episode had when its policy last acted."""
        return self._last.steps if self._last else 0


class RemoteChild(Child[T]):
    """A process beside an actor; the death of the actor is its own."""

    _launch: Launch

    def __init__(self, kind: Any) -> None:
        """Make the actor, which starts the process once there is room for it."""
        self._decoder = msgspec.json.Decoder(kind)
        self._messages: list[T] = []
        self._death: str | None = None
        self._unreadable: str | None = None
        self.is_ready = False
        self.node: str | None = None
        """Id of the node, once the actor is there."""
        self._actor = self._launch()
        self.clock = RemoteClock()
        self.news = self._actor.poll.remote()
        """What the actor is going to say next."""

    @property
    def is_over(self) -> bool:
        """Whether no more news will come."""
        return self._death is not None

    @property
    def has_news(self) -> bool:
        """Whether there is something to receive."""
        return bool(self._messages or self._unreadable) or self.is_over

    def send(self, request: msgspec.Struct) -> None:
        """Send a request."""
        self._actor.send.remote(msgspec.json.encode(request))

    def note_news(self) -> None:
        """Take what the actor has said, without waiting."""
        if self.is_over or not ray.wait([self.news], timeout=0)[0]:
            return
        try:
            news: News = ray.get(self.news)
        except ray.exceptions.RayError as error:
            self._death = f"its actor ended: {_first_line(error)}"
            return
        self.clock.note(news)
        try:
            self._messages += [self._decoder.decode(message) for message in news.messages]
        except (msgspec.MsgspecError, DuoBenchError) as error:
            self._unreadable = str(error)
        self._death = news.death
        if self.node is None:
            self.node = news.node
            self._arrive(news.host)
        if not self.is_over:
            self.news = self._actor.poll.remote()

    def receive(self) -> list[T]:
        """What the process has said.

        Raises:
            EOFError: It has ended.
            MessageError: A message is none of the expected kind.
        """
        self.note_news()
        if self._messages:
            said, self._messages = self._messages, []
            return said
        if self._unreadable is not None:
            raise MessageError(self._unreadable)
        if self.is_over:
            raise EOFError
        return []

    def death(self) -> str | None:
        """How the process ended, in words; None while it lives."""
        self.note_news()
        return self._death

    def death_within(self, seconds: float) -> str | None:
        """How the process ended, in words, where it may take a moment to be seen."""
        deadline = time.monotonic() + seconds
        while (death := self.death()) is None and (left := deadline - time.monotonic()) > 0:
            ray.wait([self.news], timeout=left)
        return death

    def kill(self) -> None:
        """End the actor, and with it the process and all that this has started."""
        with suppress(ray.exceptions.RayError, ValueError):
            ray.kill(self._actor)

    def _arrive(self, host: str) -> None:
        """The actor is there, at an address."""


class RemoteWorker(Worker, RemoteChild[Report]):
    """A worker beside an actor."""

    def __init__(self, launch: Launch, policy: RemotePolicy | None) -> None:
        """Make the actor."""
        self._launch = launch
        super().__init__(policy)


class RemotePolicy(PolicyProcess, RemoteChild):
    """The process of a policy beside an actor."""

    def __init__(self, launch: Launch, job: Job) -> None:
        """Make the actor."""
        self._launch = launch
        self._waiting: list[MakePolicy] = []
        super().__init__(job.policy.name, job.policy.batching, job.limits)

    def send(self, request: msgspec.Struct) -> None:
        """Send a request; that to make the policy once it is known where."""
        if isinstance(request, MakePolicy):
            self._waiting.append(request)
        else:
            super().send(request)

    def _arrive(self, host: str) -> None:
        for request in self._waiting:
            super().send(replace_field(request, host=host))


class RemoteTeam(Team):
    """Workers and policies on the nodes of a cluster."""

    def __init__(self, job: Job, workers: int, cluster: Cluster) -> None:
        """Begin without an actor.

        Args:
            job: What is played.
            workers: Most workers, of which all may be on one node.
            cluster: Where; this process is connected to it.
        """
        super().__init__(job)
        sees = bool(job.videos) or job.policy.name.kind in _MAY_SEE
        self._renderers = workers if sees else 0
        self._cluster = cluster

    def wait(self, seconds: float) -> Sequence[Worker | PolicyProcess]:
        """Wait until a process has said something, or the time is over; those that have."""
        children = self._remote
        if not any(child.has_news for child in children):
            expected = [child.news for child in children]
            if expected:
                ray.wait(expected, timeout=seconds)
            else:
                time.sleep(seconds)
        for child in children:
            child.note_news()
        return [child for child in children if child.has_news]

    @property
    def _remote(self) -> list[RemoteWorker | RemotePolicy]:
        return [child for child in self.children if isinstance(child, RemoteWorker | RemotePolicy)]

    def _new_policy(self) -> PolicyProcess:
        return RemotePolicy(self._launch_policy, self._job)

    def _new_worker(self, policy: PolicyProcess | None) -> Worker:
        beside = policy if isinstance(policy, RemotePolicy) else None
        return RemoteWorker(lambda: self._launch_worker(beside), beside)

    def _launch_policy(self) -> Any:
        # It thinks while its simulators wait, so that it needs no core of its own.
        options = {"num_cpus": 0, "num_gpus": self._cluster.policy_gpus}
        return _actor(**options, scheduling_strategy="SPREAD").remote("policy", __version__)

    def _launch_worker(self, policy: RemotePolicy | None) -> Any:
        # One that has a policy for itself is best on the same node.
        near: Any = "SPREAD"
        if policy is not None and policy.node is not None:
            near = scheduling.NodeAffinitySchedulingStrategy(policy.node, soft=True)
        actor = _actor(num_cpus=1, scheduling_strategy=near)
        return actor.remote("worker", __version__, self._renderers)


def _actor(**options: Any) -> Any:
    return ray.remote(Host).options(
        max_concurrency=_SIDE_BY_SIDE, max_restarts=0, max_task_retries=0, **options
    )


def _first_line(error: BaseException) -> str:
    """What an error of Ray says, in short."""
    lines = [line.strip() for line in escaped(str(error)).splitlines()]
    cause = next(
        (line for line in reversed(lines) if line.endswith("Error") or "Error:" in line), ""
    )
    return cause or next(filter(None, lines), type(error).__name__)
