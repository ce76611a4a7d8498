"""A policy at a server that speaks openpi's protocol: WebSocket, and MessagePack in it.

Inference happens in another thread than the server's, so that pings, `/healthz` and other clients
are answered meanwhile.
"""

from __future__ import annotations

import asyncio
import http
import logging
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import asdict
from typing import Any

import websockets
from websockets.asyncio.server import ServerConnection, serve
from websockets.http11 import Request, Response

from duobench.errors import DuoBenchError, PolicyTimeoutError, ServingError
from duobench.policy.batch import Batching, BatchPolicy
from duobench.policy.inference import BusyError, InferenceLoop
from duobench.policy.policy import PolicyMetadata
from duobench.policy.registry import PolicyName, make_batched
from duobench.policy.serving import access, limits
from duobench.policy.serving.codec import pack
from duobench.policy.serving.limits import HEALTH_PATH, PROTOCOL
from duobench.policy.serving.session import ClientSession

_log = logging.getLogger(__name__)

_GOING_AWAY, _INTERNAL_ERROR, _TRY_AGAIN = 1001, 1011, 1013
_LONGEST_REASON = 120
"""Bytes of the reason for closing a connection; a WebSocket takes three more."""


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
        answer_s: float = limits.INFERENCE_S,
    ) -> None:
        """Start to listen; `run` answers.

        Args:
            policy: The policy.
            metadata: What clients get to know about it.
            batching: How many observations are answered together.
            host: Address to listen at.
            port: Port to listen at; 0 takes a free one.
            key: What clients must have; without one, `host` must be of this machine only.
            busy: Surrounds everything that the policy does.
            answer_s: Seconds for one answer, waiting included.

        Raises:
            ServingError: If the address cannot be had, or needs a key.
        """
        access.check_access(host, key)
        self._policy = policy
        self._loop = InferenceLoop(policy, batching, busy=busy)
        served = {**asdict(metadata), "batch": batching.mode, "max_batch": batching.size}
        self._handshake = pack({"duobench": {"protocol": PROTOCOL, **served}})
        self._key = key
        self._answer_s = answer_s
        self._clients: dict[ServerConnection, ClientSession] = {}  # the longest silent one first
        self._closing: set[asyncio.Future[None]] = set()
        self._over = asyncio.Event()
        listening: Future[tuple[int, asyncio.AbstractEventLoop]] = Future()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve(host, port, listening)),
            name="policy-server",
            daemon=True,
        )
        self._thread.start()
        self.port, self._events = listening.result()
        """The port that it listens at."""

    def run(self) -> None:
        """Answer until `stop` is called, then close server and policy."""
        try:
            self._loop.run()
        finally:
            with suppress(RuntimeError):  # it is over already
                self._events.call_soon_threadsafe(self._over.set)
            self._thread.join()
            getattr(self._policy, "close", lambda: None)()

    def stop(self) -> None:
        """Let `run` return; for other threads and signal handlers."""
        self._loop.stop()

    async def _serve(
        self, host: str, port: int, listening: Future[tuple[int, asyncio.AbstractEventLoop]]
    ) -> None:
        asyncio.get_running_loop().set_exception_handler(_Complaints())
        try:
            server = await serve(
                self._serve_client,
                host,
                port,
                process_request=self._admit,
                origins=[None],  # a browser, which may act for any web page, names its origin
                compression=None,
                max_size=limits.MAX_REQUEST,
                max_queue=limits.MAX_QUEUED_MESSAGES,
                open_timeout=limits.HANDSHAKE_S,
                close_timeout=limits.CLOSE_S,
                server_header=None,
                logger=_silent(),  # what clients do wrong is told to them
            )
        except (OSError, OverflowError, ValueError) as error:  # also ports and hosts that none are
            reason = str(getattr(error, "strerror", None) or error).rstrip(".")
            listening.set_exception(ServingError(f"Cannot listen at {host}:{port}: {reason}."))
            return
        async with server:
            actual = next(iter(server.sockets)).getsockname()[1]
            listening.set_result((actual, asyncio.get_running_loop()))
            await self._over.wait()

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer what asks for no session, and turn away who may not have one."""
        if request.path == HEALTH_PATH:
            return connection.respond(http.HTTPStatus.OK, "OK\n")
        if not access.is_allowed(request.headers.get("Authorization"), self._key):
            return connection.respond(http.HTTPStatus.UNAUTHORIZED, "A key is needed.\n")
        if len(self._clients) >= limits.MAX_CONNECTIONS and not self._dismiss_one():
            return connection.respond(http.HTTPStatus.SERVICE_UNAVAILABLE, "Too many clients.\n")
        return None

    def _dismiss_one(self) -> bool:
        """Let the client go that has been silent longest, and plays no episode; whether one was."""
        idle = (each for each, session in self._clients.items() if not session.is_playing)
        if (connection := next(idle, None)) is None:
            return False
        del self._clients[connection]
        closing = asyncio.ensure_future(connection.close(_TRY_AGAIN, "Others need the place."))
        self._closing.add(closing)
        closing.add_done_callback(self._closing.discard)
        return True

    async def _serve_client(self, connection: ServerConnection) -> None:
        """Answer one client until it leaves; its mistakes end its own connection only."""
        session = ClientSession(self._loop, self._answer_s)
        self._clients[connection] = session
        try:
            await _send(connection, self._handshake)
            while True:
                async with asyncio.timeout(limits.IDLE_S):
                    frame = await connection.recv()
                if connection in self._clients:
                    self._clients[connection] = self._clients.pop(connection)
                reply = await _unless_gone(connection, session.reply(frame))
                if reply is None:
                    return
                await _send(connection, reply)
                session.note_sent()
        except websockets.ConnectionClosed:
            pass
        except TimeoutError:
            await connection.close(_GOING_AWAY, "Silent for too long.")
        except BusyError as error:
            reason = str(error).encode()[:_LONGEST_REASON].decode(errors="ignore")
            await connection.close(_TRY_AGAIN, reason)
        except DuoBenchError as error:
            with suppress(TimeoutError, websockets.ConnectionClosed):
                await _send(connection, _words(error))
            reason = "Internal server error. Traceback included in previous frame."
            await connection.close(_INTERNAL_ERROR, reason)
        finally:
            self._clients.pop(connection, None)
            session.close()


def _words(error: DuoBenchError) -> str:
    """What a client is told of an error: a traceback of the policy, or what went wrong."""
    if isinstance(error, PolicyTimeoutError):
        return f"{PolicyTimeoutError.__name__}: {error}"
    return str(error)


class _Complaints:
    """Says once what goes wrong again and again, such as that there is no file for a connection."""

    def __init__(self) -> None:
        self._told: set[str] = set()

    def __call__(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:  # noqa: ARG002 - the library's signature
        """Handle an error that nobody else does."""
        message = str(context.get("message"))
        if message not in self._told:
            self._told.add(message)
            _log.warning("The server goes on, after: %s (%s)", message, context.get("exception"))


def _silent() -> logging.Logger:
    logger = logging.getLogger(f"{__name__}.connections")
    logger.setLevel(logging.CRITICAL + 1)
    return logger


async def _unless_gone(
    connection: ServerConnection, answering: Coroutine[Any, Any, bytes]
) -> bytes | None:
    """An answer, or None once the client has left."""
    answer = asyncio.create_task(answering)
    gone = asyncio.create_task(connection.wait_closed())
    try:
        await asyncio.wait({answer, gone}, return_when=asyncio.FIRST_COMPLETED)
        return answer.result() if answer.done() else None
    finally:
        answer.cancel()
        gone.cancel()


async def _send(connection: ServerConnection, message: str | bytes) -> None:
    """Send a message to a client that reads it."""
    async with asyncio.timeout(limits.SEND_S):
        await connection.send(message)


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
    objects = batching.size
    made, metadata, together = make_batched(PolicyName.parse(name), batching, objects=objects)
    return made, metadata, together or Batching(mode="dynamic", size=objects)
