"""The process of a policy: it acts on observations, and has no simulator to look into."""

import secrets
import threading
from functools import partial

import msgspec

from duobench.evaluation.clock import EpisodeClock
from duobench.evaluation.runners.process import (
    Parent,
    Requests,
    Stop,
    run_child,
)
from duobench.policy.batch import ONE_BY_ONE, Batching
from duobench.policy.registry import make_batched
from duobench.policy.serving.address import LOOPBACK, MAX_S, PolicyAddress
from duobench.policy.serving.host import PolicyHost
from duobench.results.run import TimeLimits


class MakePolicy(msgspec.Struct, tag=True, frozen=True, kw_only=True):
    """To the process of a policy: make it, and answer."""

    name: str
    batching: Batching | None
    """Observations in a batch of a `BatchPolicy`; None takes the default."""
    limits: TimeLimits


class Answering(msgspec.Struct, tag=True, frozen=True):
    """Report of a policy's process: the policy is made and accepts observations."""

    address: PolicyAddress


def main(
    connection: int,
    clock: int,
    host: str = LOOPBACK,
) -> None:
    """Answer until asked to stop; see `WorkerProcess`.

    It listens at `host`; that of another interface is reached by other machines.
    """
    serve = partial(_serve, clock=EpisodeClock(clock), host=host)
    run_child(connection, MakePolicy | Stop, serve)


def _serve(
    job: MakePolicy,
    parent: Parent,
    requests: Requests,
    *,
    clock: EpisodeClock,
    host: str,
) -> None:
    made, metadata, batching = make_batched(job.name, job.batching)
    key = secrets.token_urlsafe()
    server = PolicyHost(
        made,
        metadata,
        batching or ONE_BY_ONE,
        host=host,
        key=key,
        busy=lambda: clock.timed(job.limits),
        answer_s=MAX_S,  # the parent looks after its time
    )
    threading.Thread(
        target=lambda: (requests.get(), server.stop()), daemon=True
    ).start()
    address = PolicyAddress(
        host=host,
        port=server.port,
        key=key,
        batching=batching,
    )
    parent.report(Answering(address))
    server.run()
