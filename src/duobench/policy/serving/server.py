"""A server that speaks openpi's protocol: WebSocket, one request after the other, MessagePack.

Inference happens in another thread, so that pings, `/healthz` and other clients are answered
meanwhile. A client that says `reset` with prompt and seed gets answers that follow from these.
"""

from __future__ import annotations

import asyncio
import http
import operator
import threading
import time
from collections.abc import Coroutine, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import websockets
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.http11 import Request, Response

from duobench.errors import DuoBenchError, MessageError, PolicyError, ServingError
from duobench.policy.batch import Batching, Session
from duobench.policy.inference import BusyError, InferenceLoop
from duobench.policy.protocol import PolicyMetadata
from duobench.policy.serving import access, limits
from duobench.policy.serving.codec import pack, unpack
from duobench.policy.serving.limits import HEALTH_PATH, PROTOCOL

T = TypeVar("T")

RESET_STATUS = "reset successful"
"""Answer to a reset, as other servers of the protocol give it."""
_ENDPOINTS = ("infer", "reset")
_GOING_AWAY, _INTERNAL_ERROR, _TRY_AGAIN = 1001, 1011, 1013
_MILLI = 1e3


def greeting(metadata: PolicyMetadata, batching: Batching) -> dict[str, Any]:
    """The first message to a client: what is served."""
    return {
        "duobench": {
            "protocol": PROTOCOL,
            **asdict(metadata),
            "batch": batching.mode,
            "max_batch": batching.size,
        }
    }


class PolicyServer:
    """Serves what an `InferenceLoop` answers, from a thread of its own."""

    def __init__(
        self,
        loop: InferenceLoop,
        hello: Mapping[str, Any],
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        key: str | None = None,
    ) -> None:
        """Describe a server; `start` starts it.

        Args:
            loop: What answers, run by another thread.
            hello: The first message to every client.
            host: Address to listen at.
            port: Port to listen at; 0 takes a free one.
            key: What clients must have; without one, `host` must be of this machine only.

        Raises:
            ServingError: If another machine could reach the server, and there is no key.
        """
        access.check_access(host, key)
        self._loop = loop
        self._hello = pack(hello)
        self._address = host, port
        self._key = key
        self._clients = 0
        self._port: Future[int] = Future()
        self._over = asyncio.Event()
        self._events: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread(target=self._run, name="policy-server", daemon=True)

    def start(self) -> int:
        """Start to listen; the port.

        Raises:
            ServingError: If the address cannot be had.
        """
        self._thread.start()
        return self._port.result()

    def close(self) -> None:
        """Close all connections and stop to listen."""
        if self._events is not None:
            with suppress(RuntimeError):  # it is over already
                self._events.call_soon_threadsafe(self._over.set)
        self._thread.join()

    def _run(self) -> None:
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        self._events = asyncio.get_running_loop()
        host, port = self._address
        try:
            server = await serve(
                self._converse,
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
            )
        except (OSError, OverflowError, ValueError) as error:  # also ports and hosts that none are
            reason = str(getattr(error, "strerror", None) or error).rstrip(".")
            self._port.set_exception(ServingError(f"Cannot listen at {host}:{port}: {reason}."))
            return
        async with server:
            self._port.set_result(_port_of(server))
            await self._over.wait()

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer what is no conversation, and turn away who may not have one."""
        if request.path == HEALTH_PATH:
            return connection.respond(http.HTTPStatus.OK, "OK\n")
        if not access.is_allowed(request.headers.get("Authorization"), self._key):
            return connection.respond(http.HTTPStatus.UNAUTHORIZED, "A key is needed.\n")
        if self._clients >= limits.MAX_CONNECTIONS:
            return connection.respond(http.HTTPStatus.SERVICE_UNAVAILABLE, "Too many clients.\n")
        return None

    async def _converse(self, connection: ServerConnection) -> None:
        """Answer one client until it leaves; its mistakes end its own connection only."""
        self._clients += 1
        conversation = _Conversation(self._loop)
        try:
            await _send(connection, self._hello)
            while True:
                async with asyncio.timeout(limits.IDLE_S):
                    frame = await connection.recv()
                reply = await _unless_gone(connection, conversation.reply(frame))
                if reply is None:
                    return
                await _send(connection, reply)
                conversation.note_sent()
        except websockets.ConnectionClosed:
            pass
        except TimeoutError:
            await connection.close(_GOING_AWAY, "Silent for too long.")
        except BusyError as error:
            await connection.close(_TRY_AGAIN, str(error))
        except DuoBenchError as error:
            with suppress(TimeoutError, websockets.ConnectionClosed):
                await _send(connection, str(error))
            reason = "Internal server error. Traceback included in previous frame."
            await connection.close(_INTERNAL_ERROR, reason)
        finally:
            self._clients -= 1
            conversation.close()


@dataclass(frozen=True, kw_only=True, slots=True)
class _Episode:
    """What tells one episode of a client from the next."""

    prompt: str = ""
    seed: int = 0
    session_id: object = None

    def changed_by(self, request: dict[str, Any]) -> _Episode:
        """The episode that a request belongs to; takes what only says that out of it.

        Raises:
            MessageError: If the prompt is no text or the seed no whole number.
        """
        prompt, seed = request.get("prompt", self.prompt), request.pop("seed", self.seed)
        session_id = request.pop("session_id", self.session_id)
        if not isinstance(prompt, str):
            raise MessageError(f"A prompt is a text, got a {type(prompt).__name__}.")
        try:
            number = operator.index(seed)
        except TypeError:
            number = -1
        if not 0 <= number <= limits.MAX_SEED:
            raise MessageError(f"A seed is a whole number from 0, got {seed!r:.40}.")
        if not isinstance(session_id, str | int | None):
            raise MessageError(f"A session_id is a text, got a {type(session_id).__name__}.")
        return _Episode(prompt=prompt, seed=number, session_id=session_id)


class _Conversation:
    """What one connection has said so far."""

    def __init__(self, loop: InferenceLoop) -> None:
        self._loop = loop
        self._session: Session | None = None
        self._episode = _Episode()
        self._received = 0.0
        self._timing: dict[str, float] = {}

    async def reply(self, frame: str | bytes) -> bytes:
        """The answer to a request.

        Raises:
            MessageError: If the request cannot be understood.
            PolicyError: If the policy fails.
            BusyError: If too many requests wait.
        """
        self._received = time.monotonic()
        if isinstance(frame, str):
            raise MessageError("A request is a binary message, got text.")
        request = unpack(frame)
        endpoint = request.pop("endpoint", "infer")
        if not isinstance(endpoint, str) or endpoint not in _ENDPOINTS:
            raise MessageError(
                f"The endpoint of a request is infer or reset, got {endpoint!r:.40}."
            )
        if endpoint == "reset":
            await self._begin(_Episode().changed_by(request))
            return pack({"status": RESET_STATUS})
        return await self._infer(request)

    def note_sent(self) -> None:
        """An answer was sent; the next one tells how long it took."""
        self._timing = {"prev_total_ms": (time.monotonic() - self._received) * _MILLI}

    def close(self) -> None:
        """The connection is over."""
        if self._session is not None:
            self._loop.end(self._session)
            self._session = None

    async def _infer(self, request: dict[str, Any]) -> bytes:
        episode = self._episode.changed_by(request)
        session = self._session
        if session is None or episode != self._episode:
            session = await self._begin(episode)
        start = time.monotonic()
        chunk = await _result(self._loop.act(session, request))
        timing = {"infer_ms": (time.monotonic() - start) * _MILLI, **self._timing}
        return pack({"actions": chunk, "server_timing": timing})

    async def _begin(self, episode: _Episode) -> Session:
        """Begin an episode in place of the last one."""
        self.close()
        future = self._loop.begin(episode.prompt, episode.seed)
        try:
            self._session = session = await _result(future)
        except BaseException:
            future.add_done_callback(self._forget)
            raise
        self._episode = episode
        return session

    def _forget(self, future: Future[Session]) -> None:
        """End an episode that began after its client had left."""
        if not future.cancelled() and future.exception() is None:
            self._loop.end(future.result())


async def _result(future: Future[T]) -> T:
    """What the inference loop answers; giving up gives the place in its queue back."""
    try:
        async with asyncio.timeout(limits.INFERENCE_S):
            return await asyncio.wrap_future(future)
    except TimeoutError as error:
        raise PolicyError(f"There was no answer within {limits.INFERENCE_S:g} s.") from error
    except asyncio.CancelledError:
        task = asyncio.current_task()
        if task is not None and task.cancelling():
            raise
        raise BusyError("The policy's server has ended.") from None


async def _unless_gone(
    connection: ServerConnection, answering: Coroutine[Any, Any, bytes]
) -> bytes | None:
    """An answer, or None once nobody is there any more to get it."""
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


def _port_of(server: Server) -> int:
    """The port that a server listens at."""
    return next(iter(server.sockets)).getsockname()[1]
