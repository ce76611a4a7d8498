"""Which policy plays, and how: by itself, in batches, or at a server."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pkgutil import resolve_name

from duobench.errors import PolicyError
from duobench.evaluation import policies
from duobench.evaluation.limits import TimeLimits
from duobench.evaluation.policies import PolicySource
from duobench.evaluation.suite import TaskInfo
from duobench.policy import Batching
from duobench.policy.serving import importing
from duobench.policy.serving.address import OPENPI, SERVED, RemoteServer


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyChoice:
    """A policy by its name, and whether it plays in batches or at a server."""

    name: str
    """`expert`, a baseline's name, `module:attribute`, or a name of `SERVED`."""
    batching: Batching | None = None
    """How many observations a `BatchPolicy` answers together; None takes the default."""
    server: RemoteServer | None = None
    """Where it is served."""

    def check(self) -> None:
        """Reject what cannot be chosen, without making a policy.

        Raises:
            UnknownNameError: If there is no policy of that name.
            PolicyError: If the name is no text, or does not go with the rest.
        """
        if self.name not in SERVED:
            policies.check_name(self.name)
        elif self.server is None:
            raise PolicyError(f"The policy {self.name!r} is served somewhere: it needs an address.")
        elif self.batching is not None:
            raise PolicyError("How many observations are answered together is up to the server.")


def find_source(
    choice: PolicyChoice, tasks: Sequence[TaskInfo], limits: TimeLimits
) -> PolicySource:
    """Make the policy of a choice, or connect to it.

    Raises:
        UnknownNameError: If there is no policy of that name.
        PolicyError: If it cannot be made.
        ServingError: If the server cannot be used.
        MachineryError: If there is no server.
    """
    choice.check()
    if choice.server is None:
        return policies.source(choice.name, tasks, choice.batching)
    path = SERVED.get(choice.name, OPENPI)  # a policy of another name is hosted by another process
    with importing():
        client = resolve_name(path)
    remote = client(replace(choice.server, answer_s=limits.served_s))
    return PolicySource(
        name=choice.name,
        metadata=remote.metadata,
        bind=lambda _env: remote,
        close=remote.close,
        batching=remote.batching,
    )
