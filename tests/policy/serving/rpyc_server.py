"""A server that speaks RPyC's protocol as VLAgents' does, in a thread, and misbehaves as asked."""

import json
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from duobench.policy.serving.brine import dump, load

TIMEOUT_S = 30
ROOT = ("vlagents.server.AgentService", 5, 7)
TRUE, FALSE = b"\x03", b"\x04"
REPLY, EXCEPTION = 2, 3
ERROR = (("builtins", "KeyError"), ("no such camera",), (), "Traceback\nKeyError: 'no such camera'")


def frame(kind: int, number: int, content: bytes) -> bytes:
    """A message of RPyC."""
    data = bytes([kind]) + b"\x11" + dump(number) + content
    return struct.pack("!LB", len(data), 0) + data + b"\n"


def value(packed: bytes) -> bytes:
    return b"\x11" + dump(1) + packed


Answer = Callable[[int, str, tuple[Any, ...]], bytes | None]


def agent(act: Callable[[dict[str, Any]], str], name: str = "tiny") -> Answer:
    """An honest server whose agent is a function from an observation to a text."""

    def answer(number: int, method: str, arguments: tuple[Any, ...]) -> bytes | None:
        match method:
            case "name":
                return frame(REPLY, number, value(dump(name)))
            case "is_initialized":
                return frame(REPLY, number, value(TRUE))
            case "act":
                return frame(REPLY, number, value(dump(act(json.loads(arguments[0])))))
        return frame(EXCEPTION, number, dump(ERROR))

    return answer


@contextmanager
def calls_served(answer: Answer, port: int = 0) -> Iterator[int]:
    """Serve calls: a function gives the bytes that are sent for each; None leaves."""
    ended = threading.Event()
    listener = socket.create_server(("127.0.0.1", port))
    open_sockets: list[socket.socket] = []

    def converse(connection: socket.socket) -> None:
        with suppress(OSError, EOFError), connection, connection.makefile("rb") as stream:
            while header := stream.read(5):
                size, _ = struct.unpack("!LB", header)
                data = stream.read(size + 1)[:-1]
                number, (handler, boxed) = load(data[1:])
                if handler == 3:
                    label = b"\x11" + dump(4)
                    connection.sendall(frame(REPLY, number, label + dump(ROOT)))
                    continue
                _, (_, (_, method), *rest) = boxed
                reply = answer(number, method, rest[0][1] if rest else ())
                if reply is None:
                    return
                connection.sendall(reply)

    def accept() -> None:
        while not ended.is_set():
            with suppress(OSError):
                connection, _ = listener.accept()
                open_sockets.append(connection)
                threading.Thread(target=converse, args=[connection], daemon=True).start()

    thread = threading.Thread(target=accept, daemon=True)
    thread.start()
    try:
        yield listener.getsockname()[1]
    finally:
        ended.set()
        with suppress(OSError):
            listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        for connection in open_sockets:
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        thread.join(TIMEOUT_S)
