"""A policy by its name, its inference loop and its server, put together."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from duobench.policy.batch import Batching, BatchPolicy
from duobench.policy.inference import InferenceLoop
from duobench.policy.pool import PolicyPool
from duobench.policy.protocol import Policy, PolicyMetadata
from duobench.policy.registry import make, make_any, versioned_metadata
from duobench.policy.serving.server import PolicyServer, greeting


class PolicyHost:
    """A policy with a server before it; the thread that made it answers."""

    def __init__(
        self,
        policy: BatchPolicy,
        metadata: PolicyMetadata,
        batching: Batching,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        key: str | None = None,
        busy: Callable[[], AbstractContextManager[Any]] = nullcontext,
    ) -> None:
        """Start to listen; `run` answers.

        Args:
            policy: The policy.
            metadata: What clients are told about it.
            batching: How many observations are answered together.
            host: Address to listen at.
            port: Port to listen at; 0 takes a free one.
            key: What clients must have; without one, `host` must be of this machine only.
            busy: Surrounds everything that the policy does.

        Raises:
            ServingError: If the address cannot be had, or needs a key.
        """
        self._policy = policy
        self._loop = InferenceLoop(policy, batching, busy=busy)
        hello = greeting(metadata, batching)
        self._server = PolicyServer(self._loop, hello, host=host, port=port, key=key)
        self.port = self._server.start()
        """The port that it listens at."""

    def run(self) -> None:
        """Answer until somebody calls `stop`, then close server and policy."""
        try:
            self._loop.run()
        finally:
            self._server.close()
            getattr(self._policy, "close", lambda: None)()

    def stop(self) -> None:
        """Let `run` return; for other threads and signal handlers."""
        self._loop.stop()


def make_served(name: str, batching: Batching) -> tuple[BatchPolicy, PolicyMetadata, Batching]:
    """Make a policy of either kind for many episodes at a time.

    Args:
        name: A baseline's name, or `module:attribute`.
        batching: How many observations are answered together. A plain policy answers one after
            the other, with an object for each episode and as many as this has places.

    Returns:
        The policy, what it says about itself, and how it is asked.

    Raises:
        UnknownNameError: If there is no baseline of that name.
        PolicyError: If it cannot be made.
    """
    made = make_any(name)
    metadata = versioned_metadata(name, made)
    if isinstance(made, BatchPolicy):
        return made, metadata, batching
    return _pool(name, made, batching), metadata, Batching(mode="dynamic", size=batching.size)


def _pool(name: str, first: Policy, batching: Batching) -> BatchPolicy:
    return PolicyPool(first, lambda: make(name), batching.size)
