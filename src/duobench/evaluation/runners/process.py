"""Child processes: messages between both ends, and the end of a process.

`Transport` is a process as the one sees it that has started it; `WorkerProcess` is one on this
machine. It leads a process group, in a session of its own. Its parent ends it as a group, and it
ends its group itself when its parent is gone, so that what a policy has started ends with it
(unless that has left the group, as a daemon does).
"""

import atexit
import json
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn, Protocol

import msgspec

from duobench.core.errors import (
    DuoBenchError,
    EvaluationError,
    MachineryError,
    MessageError,
    escaped,
    traceback_text,
)
from duobench.core.machine import Awake, fill_streams, watch_parent
from duobench.evaluation.clock import ClockReading, EpisodeClock

Requests = queue.SimpleQueue[Any]

DEATH_S = 10.0
"""Seconds to wait for the end of a killed process."""
DEATH_SEEN_S = 1.0
"""Seconds after a lost connection in which the end of a process may be noticed."""
RESULT_BYTES = 512 << 20
"""Most bytes of a message, which may hold a video and a recording of half an hour."""
POLICY_BYTES = 1 << 20
"""Most bytes of a message from a policy's process, which says that it answers, or why it cannot."""
_PIECE = 1 << 17
"""Bytes that are read at once: as many empty lines take some megabytes, not more."""
_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from {module} import main; main(int(sys.argv[2]), int(sys.argv[3]), *sys.argv[4:])"
)


class Transport(Protocol):
    """A process, as the one sees it that has started it, wherever it is."""

    @property
    def is_taken(self) -> bool:
        """Whether it did not end by itself, but with the machine that it was on."""
        ...

    def send(self, request: msgspec.Struct) -> None:
        """Send a request; whether the process still lives is found out elsewhere."""
        ...

    def receive(self) -> list[Any]:
        """Return its messages that were not received yet."""
        ...

    def death(self) -> str | None:
        """End of the process in words; None while it lives."""
        ...

    def clock(self) -> ClockReading:
        """Seconds for which its policy, or one that it waits for, has been busy."""
        ...

    def kill(self) -> None:
        """End it, and all that it has started."""
        ...


def death_within(process: Transport, seconds: float) -> str | None:
    """Describe the end of a process, which may take a moment to be noticed."""
    deadline = time.monotonic() + seconds
    while (death := process.death()) is None and time.monotonic() < deadline:
        time.sleep(seconds / 100)
    return death


class ProcessFailed(msgspec.Struct, tag=True, frozen=True):
    """Report of a process: no process of its kind can do the work."""

    error: str
    message: str


class Stop(msgspec.Struct, tag=True, frozen=True):
    """To a process: free everything and leave."""


class Channel:
    """One end of a connection, on which every message is a line of JSON.

    Args:
        connection: A connected socket, which belongs to the channel from now on.
        kind: Type of the messages that are received, or a union of such types.
        most: Bytes of a message, from which on it is not read.
    """

    def __init__(
        self, connection: socket.socket, kind: Any, most: int = RESULT_BYTES
    ) -> None:
        self.socket = connection
        self._most = most
        self._decoder = msgspec.json.Decoder(kind)
        self._rest = bytearray()

    def send(self, message: Any) -> None:
        """Send a message."""
        self.socket.sendall(msgspec.json.encode(message) + b"\n")

    def receive(self) -> list[Any]:
        """Read what has arrived; the messages that are complete.

        It waits only if nothing has arrived: an end of the channel that dies in the middle of a
        message leaves it incomplete, also while a child of it keeps the channel open.
        """
        try:
            piece = self.socket.recv(_PIECE)
        except ConnectionError:
            piece = b""
        if not piece:
            raise EOFError
        self._rest += piece
        if b"\n" not in piece:  # of a long message, such as one with a video
            if len(self._rest) > self._most:
                raise MessageError(f"a message has more than {self._most} bytes")
            return []
        *lines, self._rest = self._rest.split(b"\n")
        try:
            return [self._decoder.decode(line) for line in lines]
        except (msgspec.MsgspecError, DuoBenchError) as error:
            raise MessageError(str(error)) from error


class WorkerProcess:
    """A process on this machine that runs `main(connection, clock, *arguments)` of a module.

    It gets file descriptors of its socket and of the memory of its clock.

    Args:
        module: The module.
        kind: Type of the messages that it sends.
        arguments: Further arguments.
        hidden: Environment variables that it does not get.
        most: Bytes of a message of its.
    """

    is_taken = False
    """Never: this process is on the same machine."""

    def __init__(
        self,
        module: str,
        kind: Any,
        *arguments: str,
        hidden: Collection[str] = (),
        most: int = RESULT_BYTES,
    ) -> None:
        fill_streams()
        ours, theirs = socket.socketpair()
        self._channel = Channel(ours, kind, most)
        memory = os.memfd_create("duobench-clock")
        os.ftruncate(memory, EpisodeClock.SIZE)
        self._awake = Awake()
        self._clock = EpisodeClock(memory, self._awake)
        files = (theirs.fileno(), memory)
        # In safe mode (-P), the current folder does not come before the standard library.
        flags = subprocess._args_from_interpreter_flags()  # pyright: ignore[reportAttributeAccessIssue]
        # Sets of texts have one order in every process.
        environment = {"PYTHONHASHSEED": "0", **os.environ}
        command = [sys.executable, *flags, "-P", "-c", _START.format(module=module)]
        try:
            self._process = subprocess.Popen(
                [*command, json.dumps(_module_folders()), *map(str, files), *arguments],
                pass_fds=files,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
                env={
                    each: value
                    for each, value in environment.items()
                    if each not in hidden
                },
            )
        except OSError as error:
            raise MachineryError(f"A process cannot be started: {error}.") from error
        finally:
            theirs.close()
            os.close(memory)

    def fileno(self) -> int:
        """Descriptor of the connection, to wait for."""
        return self._channel.socket.fileno()

    def send(self, request: Any) -> None:
        """Send a request; whether the process still lives is found out elsewhere."""
        with suppress(OSError):
            self._channel.send(request)

    def receive(self) -> list[Any]:
        """Read what has arrived; see `Channel.receive`."""
        return self._channel.receive()

    def clock(self) -> ClockReading:
        """Return the reading of its clock; who asks many times a second may be stopped with it."""
        self._awake.note()
        return self._clock.read()

    def death(self) -> str | None:
        """End of the process in words; None while it lives.

        Its exit code is left to be read again: until then no other process gets its number, or
        that of its group.
        """
        end = os.waitid(
            os.P_PID, self._process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT
        )
        if end is None:
            return None
        if end.si_code == os.CLD_EXITED:
            return f"its process ended with exit code {end.si_status}."
        with suppress(ValueError):
            return f"its process was ended by {signal.Signals(end.si_status).name}."
        return f"its process was ended by signal {end.si_status}."

    def kill(self) -> None:
        """End the process and all of its group."""
        with suppress(OSError):
            os.killpg(self._process.pid, signal.SIGKILL)
        # A process that a driver keeps from dying is not waited for.
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(DEATH_S)
        self._channel.socket.close()


def _module_folders() -> list[str]:
    """Return the folders of modules here, absolute, and the current folder last.

    A module there must be found, but must not stand in for one of the standard library.
    """
    try:
        here = str(Path.cwd())
    except FileNotFoundError:  # it was deleted; relative entries lead nowhere
        return [entry for entry in sys.path if Path(entry).is_absolute()]
    folders = [str(Path(here, entry)) for entry in sys.path]
    return [folder for folder in folders if folder != here] + [here] * (here in folders)


class Parent(Channel):
    """The parent as a child sees it; without one there is no reason to go on."""

    def report(self, report: msgspec.Struct) -> None:
        """Tell the parent."""
        try:
            self.send(report)
        except OSError:
            end_group()


def run_child(
    connection: int, kind: Any, do: Callable[[Any, Parent, Requests], None]
) -> NoReturn:
    """Do what a process is for until it is done, or its parent is gone; see `WorkerProcess`.

    Args:
        connection: Descriptor of the socket to the parent.
        kind: Type of the requests of the parent, or a union of such types.
        do: Does the first request, unless that is to stop; it gets the queue of the others.
    """
    signal.signal(signal.SIGINT, lambda _number, _frame: None)  # the parent's to handle
    parent = Parent(socket.socket(fileno=connection), kind)
    requests: Requests = queue.SimpleQueue()
    watch_parent(os.getppid(), end_group)
    threading.Thread(target=_listen, args=(parent, requests), daemon=True).start()
    try:
        job = requests.get()
        if not isinstance(job, Stop):
            do(job, parent, requests)
    except DuoBenchError as error:
        parent.report(
            ProcessFailed(error=type(error).__name__, message=escaped(str(error)))
        )
    except BaseException as error:  # noqa: BLE001 - a process boundary; the parent raises it
        text = f"A process of the evaluation failed.\n{traceback_text(error)}"
        parent.report(ProcessFailed(error=EvaluationError.__name__, message=text))
    # Exit handlers are the policy's; taking the interpreter down is skipped: graphics drivers
    # have crashed there. The parent ends the rest.
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(
            AttributeError, OSError, ValueError
        ):  # a policy may have closed it
            stream.flush()
    os._exit(0)


def end_group() -> None:
    """End this process and all that it has started."""
    os.killpg(0, signal.SIGKILL)


def _listen(parent: Parent, requests: Requests) -> None:
    """Pass requests on; when the parent has closed the connection, end the group at once."""
    with suppress(EOFError, OSError):
        while True:
            for request in parent.receive():
                requests.put(request)
    end_group()
