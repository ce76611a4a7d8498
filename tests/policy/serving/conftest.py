from collections.abc import Callable, Iterator
from typing import Any

import pytest

from duobench.policy.serving.address import RemoteServer
from tests.policy.serving.serving import TIMEOUT_S, Serve, server_at


@pytest.fixture
def serve() -> Iterator[Serve]:
    serving = Serve()
    yield serving
    serving.close()


@pytest.fixture
def connect() -> Iterator[Callable[..., Any]]:
    """Makes clients of a kind, which ask a port of this machine without waiting for it."""
    made = []

    def make(kind: Callable[[RemoteServer], Any], port: int, path: str = "", **options: Any) -> Any:
        options = {"answer_s": TIMEOUT_S} | options
        made.append(kind(server_at(port, path, **options)))
        return made[-1]

    yield make
    for policy in made:
        policy.close()
