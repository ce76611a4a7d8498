"""WebSocket server in a thread of its own, so that computations never wait for a client."""

import asyncio
import logging
import os
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from contextlib import suppress
from typing import Any

from websockets.asyncio.server import ServerConnection, serve

from duobench.core.errors import ServingError

_log = logging.getLogger(__name__)
_connections = logging.getLogger(f"{__name__}.connections")
_connections.setLevel(logging.CRITICAL + 1)  # a client hears what it does wrong


async def _nothing() -> None:
    return


class _Connection(ServerConnection):
    """A connection whose pings draw nothing from the generator that policies may draw from."""

    async def ping(self, data: Any = None) -> Awaitable[float]:
        return await super().ping(os.urandom(4) if data is None else data)


class ServingThread:
    """A server that listens from the start, at a free port for port 0.

    Args:
        handler: Serves one connection, in the thread.
        host: Address to listen at.
        port: Port to listen at.
        name: That of the thread.
        ending: What the thread does last, while connections are still open.
        options: Of `websockets.asyncio.server.serve`.
    """

    _events: asyncio.AbstractEventLoop

    def __init__(
        self,
        handler: Callable[[ServerConnection], Awaitable[None]],
        host: str,
        port: int,
        *,
        name: str,
        ending: Callable[[], Awaitable[None]] = _nothing,
        **options: Any,
    ) -> None:
        self._over = asyncio.Event()
        self._complaints: set[str] = set()
        listening: Future[int] = Future()

        async def run() -> None:
            self._events = asyncio.get_running_loop()
            self._events.set_exception_handler(self._complain)
            options.update(compression=None, server_header=None, logger=_connections)
            try:
                server = await serve(
                    handler,
                    host,
                    port,
                    create_connection=_Connection,
                    **options,
                )
            except (
                OSError,
                OverflowError,
                ValueError,
            ) as error:  # also what is no host or port
                reason = str(getattr(error, "strerror", None) or error).rstrip(".")
                listening.set_exception(
                    ServingError(f"Cannot listen at {host}:{port}: {reason}.")
                )
                return
            async with server:
                listening.set_result(next(iter(server.sockets)).getsockname()[1])
                await self._over.wait()
                await ending()

        self._thread = threading.Thread(
            target=lambda: asyncio.run(run()), name=name, daemon=True
        )
        self._thread.start()
        self.port: int = listening.result()
        """The port that it listens at."""

    def call(self, function: Callable[..., object], *arguments: object) -> None:
        """Call a function in the thread, soon; once the server is closed, never."""
        with suppress(RuntimeError):
            self._events.call_soon_threadsafe(function, *arguments)

    def close(self) -> None:
        """Close all connections, and wait for the thread; closing twice is harmless."""
        self.call(self._over.set)
        self._thread.join()

    def _complain(
        self, _loop: asyncio.AbstractEventLoop, context: dict[str, Any]
    ) -> None:
        # Once: it may go wrong again and again, such as that no connection can be opened.
        message = str(context.get("message"))
        if message not in self._complaints:
            self._complaints.add(message)
            _log.warning(
                "The server goes on, after: %s (%s)", message, context.get("exception")
            )
