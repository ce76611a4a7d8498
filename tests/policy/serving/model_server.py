"""A model server as those of vla-eval 0.8 behave, written from its protocol alone."""

import http
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from typing import Any

import msgpack
import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection

from tests.policy.serving.serving import listening

Message = dict[str, Any]
Answer = Callable[[Message], bytes | str | None]
"""From an observation to a whole frame; None leaves without an answer."""

HELLO = {
    "harness_version": "0.8.0",
    "protocol_version": 1,
    "model_server": "Toy",
    "capabilities": {},
}


def frame(kind: object, payload: object, seq: object) -> bytes:
    """A message as vla-eval writes it."""
    return packed({"type": kind, "payload": payload, "seq": seq, "timestamp": time.time()})


def packed(value: object) -> bytes:
    """Any value as vla-eval writes it."""
    return msgpack.packb(value, default=_encoded) or b""


def _encoded(value: np.ndarray) -> dict[str, Any]:
    array = {"__ndarray__": True, "data": value.tobytes(), "dtype": value.dtype.str}
    return {**array, "shape": list(value.shape)}


def _decoded(value: dict[str, Any]) -> Any:
    if "__ndarray__" not in value:
        return value
    return np.frombuffer(value["data"], np.dtype(value["dtype"])).reshape(value["shape"])


class ModelServer:
    """What was received, and how observations are answered."""

    def __init__(self, answer: Answer, hello: Message | None = None, *, lives: bool = True) -> None:
        self.received: list[Message] = []
        self.hello = HELLO | (hello or {})
        self.answer = answer
        self.lives = lives
        self.connections = 0

    def of(self, kind: str) -> list[Message]:
        return [message for message in self.received if message["type"] == kind]

    def converse(self, connection: ServerConnection) -> None:
        self.connections += 1
        with suppress(ConnectionClosed):
            for data in connection:
                message = msgpack.unpackb(data, object_hook=_decoded)
                self.received.append(message)
                if message["type"] == "hello":
                    connection.send(frame("hello", self.hello, message["seq"]))
                elif message["type"] == "observation":
                    if (reply := self.answer(message)) is None:
                        return
                    connection.send(reply)

    def admit(self, connection: ServerConnection, request: Request) -> Response | None:
        if request.path != "/health":
            return None
        status = http.HTTPStatus.OK if self.lives else http.HTTPStatus.SERVICE_UNAVAILABLE
        return connection.respond(status, '{"status": "ok"}\n')

    def running(self, port: int = 0) -> AbstractContextManager[int]:
        """Listen as long as the block lasts; the port."""
        return listening(self.converse, port, max_size=None, process_request=self.admit)


def acting(actions: object) -> Answer:
    """Answers every observation with the same actions."""
    return lambda message: frame("action", {"actions": actions}, message["seq"])
