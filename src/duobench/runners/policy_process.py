"""The process of a policy: it answers observations, and has no simulator to look into."""

from __future__ import annotations

import secrets
import threading

import msgspec

from duobench.evaluation.clock import EpisodeClock
from duobench.evaluation.policies import LOOPBACK, PolicyAddress
from duobench.policy.batch import ONE_BY_ONE, Batching
from duobench.policy.registry import PolicyName, make_batched
from duobench.policy.serving.address import MAX_S
from duobench.policy.serving.host import PolicyHost
from duobench.results.limits import TimeLimits
from duobench.runners.child import Child, Parent, Refused, Requests, run_child


class MakePolicy(msgspec.Struct, tag=True, frozen=True, kw_only=True):
    """To the process of a policy: make it, and answer."""

    name: PolicyName
    """The policy."""
    batching: Batching | None
    """How many observations a `BatchPolicy` answers together; None takes the default."""
    limits: TimeLimits
    """How long it may take."""
    host: str = LOOPBACK
    """Address at which it listens; that of another interface is reached by other machines."""


class StopAnswering(msgspec.Struct, tag=True, frozen=True):
    """To the process of a policy: free everything and leave."""


class Answering(msgspec.Struct, tag=True, frozen=True):
    """From the process of a policy: it is made, and answers."""

    address: PolicyAddress


class PolicyProcess(Child[Answering | Refused]):
    """The process of a policy, as its parent sees it."""

    module = __name__

    def __init__(self, name: PolicyName, batching: Batching | None, limits: TimeLimits) -> None:
        """Start the process and have it make the policy.

        Args:
            name: The policy.
            batching: How many observations a `BatchPolicy` answers together.
            limits: How long it may take.

        Raises:
            MachineryError: The process cannot be started.
        """
        super().__init__(Answering | Refused)
        self.send(MakePolicy(name=name, batching=batching, limits=limits))
        self.address: PolicyAddress | None = None
        """Where it answers, once it does."""


def main(connection: int, clock: int) -> None:
    """Answer until asked to stop.

    Args:
        connection: File descriptor of the socket to the parent.
        clock: File descriptor of the clock.
    """
    run_child(
        connection,
        MakePolicy | StopAnswering,
        lambda parent, requests: _answer(parent, requests, EpisodeClock(clock)),
    )


def _answer(parent: Parent, requests: Requests, clock: EpisodeClock) -> None:
    job = requests.get()
    if not isinstance(job, MakePolicy):
        return
    made, metadata, batching = make_batched(job.name, job.batching)
    key = secrets.token_urlsafe()
    host = PolicyHost(
        made,
        metadata,
        batching or ONE_BY_ONE,
        host=job.host,
        key=key,
        busy=lambda: clock.timed(job.limits),
        answer_s=MAX_S,  # the parent looks after its time
    )
    threading.Thread(target=lambda: (requests.get(), host.stop()), daemon=True).start()
    parent.report(
        Answering(PolicyAddress(host=job.host, port=host.port, key=key, batching=batching))
    )
    host.run()
