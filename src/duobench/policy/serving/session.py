"""The session of one client with a server that speaks openpi's protocol.

A client that says `reset` with prompt and seed gets answers that follow from these.
"""

from __future__ import annotations

import asyncio
import time
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from duobench.errors import MessageError, PolicyError
from duobench.policy.batch import Session
from duobench.policy.inference import BusyError, InferenceLoop
from duobench.policy.serving import limits
from duobench.policy.serving.codec import pack, unpack
from duobench.types import as_whole

T = TypeVar("T")

_RESET_STATUS = "reset successful"
"""Answer to a reset, as other servers of the protocol give it."""
_ENDPOINTS = ("infer", "reset")
_MILLI = 1e3


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
        number = as_whole(seed)
        if number is None or not 0 <= number <= limits.MAX_SEED:
            raise MessageError(f"A seed is a whole number from 0, got {seed!r:.40}.")
        if not isinstance(session_id, str | int | None):
            raise MessageError(f"A session_id is a text, got a {type(session_id).__name__}.")
        return _Episode(prompt=prompt, seed=number, session_id=session_id)


class ClientSession:
    """Episodes and requests of one connection."""

    def __init__(self, loop: InferenceLoop, answer_s: float = limits.INFERENCE_S) -> None:
        """Begin without an episode.

        Args:
            loop: What answers.
            answer_s: Seconds for one answer, waiting included.
        """
        self._loop = loop
        self._answer_s = answer_s
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
            return pack({"status": _RESET_STATUS})
        return await self._infer(request)

    @property
    def is_playing(self) -> bool:
        """Whether an episode is under way."""
        return self._session is not None

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
        answer = self._loop.act(session, request)
        chunk = await self._result(answer)
        timing = {"infer_ms": (time.monotonic() - start) * _MILLI, **self._timing}
        timing["policy_ms"] = answer.busy_s * _MILLI
        intended = getattr(session, "intended", None)
        said = {} if intended is None else {"intended": np.asarray(intended)}
        return pack({"actions": chunk, **said, "server_timing": timing})

    async def _begin(self, episode: _Episode) -> Session:
        self.close()
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
        """What the inference loop answers; giving up gives the place in its queue back."""
        try:
            async with asyncio.timeout(self._answer_s):
                return await asyncio.wrap_future(future)
        except TimeoutError as error:
            raise PolicyError(f"There was no answer within {self._answer_s:g} s.") from error
        except asyncio.CancelledError:
            task = asyncio.current_task()
            if task is not None and task.cancelling():
                raise
            raise BusyError("The policy's server has ended.") from None
