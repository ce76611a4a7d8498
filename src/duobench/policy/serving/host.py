"""A policy at a server that speaks openpi's protocol: WebSocket, and MessagePack in it.

Inference happens in another thread than the server's, so that pings, `/healthz` and other clients
are answered meanwhile.
"""

import asyncio
import http
import math
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import numpy as np
import websockets
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from duobench.core.errors import (
    DuoBenchError,
    MessageError,
    PolicyError,
    PolicyTimeoutError,
)
from duobench.core.serving_thread import ServingThread
from duobench.core.types import as_whole
from duobench.policy.batch import (
    ONE_BY_ONE,
    Batching,
    BatchPolicy,
    PolicyPool,
    Session,
)
from duobench.policy.inference import BusyError, InferenceLoop
from duobench.policy.policy import PolicyMetadata
from duobench.policy.registry import make_batched
from duobench.policy.serving import access, limits
from duobench.policy.serving.codec import pack, unpack
from duobench.policy.serving.limits import HEALTH_PATH, PROTOCOL

T = TypeVar("T")

_GOING_AWAY, _INTERNAL_ERROR, _TRY_AGAIN = 1001, 1011, 1013
_LONGEST_REASON = 120
"""Bytes of the reason for closing a connection; a WebSocket takes three more."""
_RESET_STATUS = "reset successful"
"""Reply to a reset, as other servers of the protocol give it."""
_ENDPOINTS = ("infer", "reset")
_MILLI = 1e3


class PolicyHost:
    """A policy with a server before it; the thread that made it answers.

    Args:
        policy: The policy.
        metadata: What clients get to know about it.
        batching: How many observations a batch has.
        host: Address to listen at; that of other machines needs a key.
        port: Port to listen at; 0 takes a free one.
        key: What clients must have.
        busy: Surrounds everything that the policy does.
        answer_s: Seconds for one chunk, waiting included.
    """

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
        access.check_access(host, key)
        self._policy = policy
        self._loop = InferenceLoop(policy, batching, busy=busy)
        served = {
            **asdict(metadata),
            "batch": batching.mode,
            "max_batch": batching.size,
        }
        self._handshake = pack({"duobench": {"protocol": PROTOCOL, **served}})
        self._key = key
        self._answer_s = answer_s
        self._places = policy.size if isinstance(policy, PolicyPool) else math.inf
        self._clients: dict[ServerConnection, ClientSession] = {}
        self._closing: set[asyncio.Future[None]] = set()
        self._server = ServingThread(
            self._serve_client,
            host,
            port,
            name="policy-server",
            process_request=self._admit,
            origins=[
                None
            ],  # a browser, which may act for any web page, names its origin
            max_size=limits.MAX_REQUEST,
            max_queue=limits.MAX_QUEUED_MESSAGES,
            open_timeout=limits.HANDSHAKE_S,
            close_timeout=limits.CLOSE_S,
        )
        self.port = self._server.port
        """The port that it listens at."""

    def run(self) -> None:
        """Serve until `stop` is called, then close server and policy."""
        try:
            self._loop.run()
        finally:
            self._server.close()
            getattr(self._policy, "close", lambda: None)()

    def stop(self) -> None:
        """Let `run` return; for other threads and signal handlers."""
        self._loop.stop()

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Serve requests without a session, and reject clients that may not have one."""
        if request.path == HEALTH_PATH:
            return connection.respond(http.HTTPStatus.OK, "OK\n")
        if not access.is_allowed(request.headers.get("Authorization"), self._key):
            return connection.respond(
                http.HTTPStatus.UNAUTHORIZED, "A key is needed.\n"
            )
        if len(self._clients) >= limits.MAX_CONNECTIONS and not self._dismiss_one():
            return connection.respond(
                http.HTTPStatus.SERVICE_UNAVAILABLE, "Too many clients.\n"
            )
        return None

    def _dismiss_one(self, *, playing: bool = False) -> bool:
        """Let the client go that has been silent longest, one that plays for `SILENT_S`, if any."""
        now = time.monotonic()
        silent = [
            (session.is_playing, session.silent_since, connection)
            for connection, session in self._clients.items()
            if now - session.silent_since >= limits.SILENT_S * session.is_playing
            and session.is_playing >= playing
        ]
        if not silent:
            return False
        *_, connection = min(silent, key=lambda one: one[:2])
        self._clients.pop(connection).close()
        closing = asyncio.ensure_future(
            _close(connection, _TRY_AGAIN, "Others need the place.")
        )
        self._closing.add(closing)
        closing.add_done_callback(self._closing.discard)
        return True

    async def _reply(self, session: "ClientSession", frame: str | bytes) -> bytes:
        """Reply of a session, which may have to wait for the place of a silent one first."""
        until = time.monotonic() + limits.SILENT_S
        sessions = self._clients.values()
        while (
            not session.is_playing
            and sum(one.is_playing for one in sessions) >= self._places
        ):
            if not self._dismiss_one(playing=True):
                if time.monotonic() > until:
                    raise BusyError(
                        f"All {self._places} places are taken; begin again later."
                    )
                await asyncio.sleep(limits.SILENT_S / 50)
        return await session.reply(frame)

    async def _serve_client(self, connection: ServerConnection) -> None:
        """Serve one client until it leaves; its errors end only its own connection."""
        session = ClientSession(self._loop, self._answer_s)
        self._clients[connection] = session
        try:
            await _send(connection, self._handshake)
            while True:
                async with asyncio.timeout(limits.IDLE_S):
                    frame = await connection.recv()
                if connection not in self._clients:
                    return  # it was dismissed meanwhile
                session.note_silence(math.inf)
                reply = await _unless_gone(connection, self._reply(session, frame))
                session.note_silence(time.monotonic())
                if reply is None:
                    return
                session.note_sent(await _send(connection, reply))
        except websockets.ConnectionClosed:
            pass
        except TimeoutError:
            await _close(connection, _GOING_AWAY, "Silent for too long.")
        except BusyError as error:
            reason = str(error).encode()[:_LONGEST_REASON].decode(errors="ignore")
            await _close(connection, _TRY_AGAIN, reason)
        except DuoBenchError as error:
            is_late = isinstance(error, PolicyTimeoutError)
            words = f"{PolicyTimeoutError.__name__}: {error}" if is_late else str(error)
            with suppress(TimeoutError, websockets.ConnectionClosed):
                await _send(connection, words)
            reason = "Internal server error. Traceback included in previous frame."
            await _close(connection, _INTERNAL_ERROR, reason)
        finally:
            self._clients.pop(connection, None)
            session.close()


@dataclass(frozen=True, kw_only=True, slots=True)
class _RequestedEpisode:
    """Key that distinguishes one episode of a client from the next."""

    prompt: str = ""
    seed: int = 0
    session_id: object = None

    def changed_by(self, request: dict[str, Any]) -> "_RequestedEpisode":
        """The episode that a request belongs to; takes what only says that out of it."""
        prompt, seed = (
            request.get("prompt", self.prompt),
            request.pop("seed", self.seed),
        )
        session_id = request.pop("session_id", self.session_id)
        if not isinstance(prompt, str):
            raise MessageError(f"A prompt is a text, got a {type(prompt).__name__}.")
        number = as_whole(seed)
        if number is None or not 0 <= number <= limits.MAX_SEED:
            raise MessageError(f"A seed is a whole number from 0, got {seed!r:.40}.")
        if not isinstance(session_id, str | int | None):
            raise MessageError(
                f"A session_id is a text, got a {type(session_id).__name__}."
            )
        return _RequestedEpisode(prompt=prompt, seed=number, session_id=session_id)


class ClientSession:
    """Episodes and requests of one connection."""

    def __init__(
        self, loop: InferenceLoop, answer_s: float = limits.INFERENCE_S
    ) -> None:
        self._loop = loop
        self._answer_s = answer_s
        self._session: Session | None = None
        self.is_playing = False
        """Whether an episode is under way, or begins."""
        self.silent_since = time.monotonic()
        """Since when its client is waited for, to ask, or to read before it asks more; infinity
        while that waits for a reply."""
        self._read: asyncio.Future[Any] | None = None
        self._episode = _RequestedEpisode()
        self._received = 0.0
        self._timing: dict[str, float] = {}

    async def reply(self, frame: str | bytes) -> bytes:
        """Reply to a request; an error if that cannot be understood, or the policy fails."""
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
            await self._begin(_RequestedEpisode().changed_by(request))
            return pack({"status": _RESET_STATUS})
        return await self._infer(request)

    def note_silence(self, since: float) -> None:
        """Note since when its client is waited for, unless that asks and does not read."""
        if self._read is None or self._read.done():
            self.silent_since = since

    def note_sent(self, read: "asyncio.Future[Any]") -> None:
        """Note that a reply was sent, and what is done once it is read.

        The next reply says how long it took.
        """
        self._read = read
        self._timing = {"prev_total_ms": (time.monotonic() - self._received) * _MILLI}

    def close(self) -> None:
        """End the episode, if there is one."""
        self.is_playing = False
        if self._session is not None:
            self._loop.end(self._session)
            self._session = None

    async def _infer(self, request: dict[str, Any]) -> bytes:
        episode = self._episode.changed_by(request)
        session = self._session
        if session is None or episode != self._episode:
            session = await self._begin(episode)
        start = time.monotonic()
        pending = self._loop.act(session, request)
        chunk = await self._result(pending)
        timing = {"infer_ms": (time.monotonic() - start) * _MILLI, **self._timing}
        timing["policy_ms"] = pending.busy_s * _MILLI
        said = {}
        if session.intended is not None:
            said = {"intended": np.asarray(session.intended)}
        return pack({"actions": chunk, **said, "server_timing": timing})

    async def _begin(self, episode: _RequestedEpisode) -> Session:
        self.close()
        self.is_playing = True
        future = self._loop.begin(episode.prompt, episode.seed)
        try:
            self._session = session = await self._result(future)
        except BaseException:
            future.add_done_callback(self._forget)
            raise
        self._episode = episode
        return session

    def _forget(self, future: Future[Session]) -> None:
        """End an episode that began after its client had left."""
        if not future.cancelled() and future.exception() is None:
            self._loop.end(future.result())

    async def _result(self, future: Future[T]) -> T:
        """Return the result of the inference loop; giving up gives the place in its queue back."""
        try:
            async with asyncio.timeout(self._answer_s):
                return await asyncio.wrap_future(future)
        except TimeoutError as error:
            raise PolicyError(
                f"There was no answer within {self._answer_s:g} s."
            ) from error
        except asyncio.CancelledError:
            task = asyncio.current_task()
            if task is not None and task.cancelling():
                raise
            raise BusyError("The policy's server has ended.") from None


async def _unless_gone(
    connection: ServerConnection, replying: Coroutine[Any, Any, bytes]
) -> bytes | None:
    """Return a reply, or None once the client has left."""
    reply = asyncio.create_task(replying)
    gone = asyncio.create_task(connection.wait_closed())
    try:
        await asyncio.wait({reply, gone}, return_when=asyncio.FIRST_COMPLETED)
        return reply.result() if reply.done() else None
    finally:
        reply.cancel()
        gone.cancel()


async def _close(
    connection: ServerConnection,
    code: int,
    reason: str,
) -> None:
    """Say goodbye; a client that reads nothing does not get it."""
    with suppress(TimeoutError):
        async with asyncio.timeout(limits.CLOSE_S):
            await connection.close(code, reason)
    connection.transport.abort()


async def _send(
    connection: ServerConnection, message: str | bytes
) -> "asyncio.Future[Any]":
    """Send a message; the future is done once the other side reads it."""
    async with asyncio.timeout(limits.SEND_S):
        read = asyncio.ensure_future(await connection.ping())
        await connection.send(message)
        return read


def make_served(
    name: str, batching: Batching
) -> tuple[BatchPolicy, PolicyMetadata, Batching]:
    """Make a policy of either kind, what it says about itself, and how it is asked.

    A plain policy acts on one observation after the other, with an object for each episode and as
    many as `batching` has places; errors are those of `duobench.policy.make`.
    """
    objects = batching.size
    made, metadata, together = make_batched(name, batching, objects=objects)
    return made, metadata, together or ONE_BY_ONE
