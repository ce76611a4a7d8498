"""Servers in threads, ours and others, for tests with real sockets."""

import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve as serve_websocket

from duobench.policy import Batching
from duobench.policy.batch import BatchPolicy
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.codec import pack
from duobench.policy.serving.host import PolicyHost
from tests.children import environment

TIMEOUT_S = 30
BATCHING = Batching(size=2)


class Serve:
    """Serves policies; calling it gives the port of another one."""

    def __init__(self) -> None:
        self.hosts: list[PolicyHost] = []
        self._threads: list[threading.Thread] = []

    def __call__(
        self,
        policy: BatchPolicy,
        key: str | None = None,
        port: int = 0,
        batching: Batching = BATCHING,
    ) -> int:
        host = PolicyHost(policy, policy.metadata, batching, key=key, port=port)
        self.hosts.append(host)
        self._threads.append(threading.Thread(target=host.run, daemon=True))
        self._threads[-1].start()
        return host.port

    def close(self) -> None:
        while self.hosts:
            self.hosts.pop().stop()
            thread = self._threads.pop()
            thread.join(TIMEOUT_S)
            assert not thread.is_alive()


def server_at(port: int, path: str = "", **options: Any) -> RemoteServer:
    """A server at a port of this machine, which is not waited for."""
    return RemoteServer(url=f"ws://127.0.0.1:{port}{path}", **{"wait_s": 0.0} | options)


def start_server(
    policy: type, port: int, *options: str, **variables: str
) -> subprocess.Popen[bytes]:
    """Start `duobench serve` in a process of its own."""
    name = f"{policy.__module__}:{policy.__name__}"
    words = ["-m", "duobench", "serve", "--policy", name, "--port", str(port), *options]
    return subprocess.Popen(
        [sys.executable, *words],
        env=environment(**variables),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


@contextmanager
def listening(
    handler: Callable[[ServerConnection], None], port: int = 0, **options: Any
) -> Iterator[int]:
    """Serve connections in a thread as long as the block lasts; the port."""
    with serve_websocket(handler, "127.0.0.1", port, compression=None, **options) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield server.socket.getsockname()[1]
        server.shutdown()
        thread.join(TIMEOUT_S)


def foreign_server(
    handshake: dict[str, Any], answer: Callable[[bytes], bytes | str | None]
) -> AbstractContextManager[int]:
    """Serve as others do: one message at a time, answered by a function; None leaves."""

    def serve_client(connection: ServerConnection) -> None:
        with suppress(ConnectionClosed):
            connection.send(pack(handshake))
            for message in connection:
                assert isinstance(message, bytes)
                if (reply := answer(message)) is None:
                    return
                connection.send(reply)

    return listening(serve_client)
