"""A child: a process of its own, as its parent sees it, and what it does itself.

A child leads a process group, in a session of its own. Its parent ends it as a group, and it ends
its group itself when its parent is gone, so that what a policy has started ends with it (unless
that has left the group, as a daemon does).
"""

from __future__ import annotations

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
from typing import Any, ClassVar, Generic, NoReturn, TypeVar

import msgspec

from duobench.errors import (
    DuoBenchError,
    EvaluationError,
    MachineryError,
    escaped,
    traceback_text,
)
from duobench.evaluation.clock import EpisodeClock
from duobench.machine import watch_parent
from duobench.runners.channel import Channel

T = TypeVar("T")
Requests = queue.SimpleQueue[Any]

DEATH_S = 10.0
"""How long a killed process is waited for, in seconds."""
_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[3]); "
    "from {module} import main; main(int(sys.argv[1]), int(sys.argv[2]))"
)


class Refused(msgspec.Struct, tag=True, frozen=True):
    """From a child: what it is for cannot be done by any of its kind."""

    error: str
    """Name of the class of the error."""
    message: str


class Child(Generic[T]):
    """A child as its parent sees it."""

    module: ClassVar[str]
    """The module whose `main(connection, clock)` it runs."""

    def __init__(self, kind: Any, hidden: Collection[str] = ()) -> None:
        """Start the process, which waits to be told what to do.

        Args:
            kind: Type of the messages that it sends.
            hidden: Environment variables that it does not get.

        Raises:
            MachineryError: The process cannot be started.
        """
        ours, theirs = socket.socketpair()
        self.channel: Channel[T] = Channel(ours, kind)
        """The connection to it."""
        memory = os.memfd_create("duobench-clock")
        os.ftruncate(memory, EpisodeClock.SIZE)
        self.clock = EpisodeClock(memory)
        """What a policy in it is doing, or one that it waits for."""
        self.is_ready = False
        """Whether it has said that it is."""
        files = (theirs.fileno(), memory)
        # In safe mode (-P), the current folder does not come before the standard library.
        flags = subprocess._args_from_interpreter_flags()  # pyright: ignore[reportAttributeAccessIssue]
        start = _START.format(module=self.module)
        command = [sys.executable, *flags, "-P", "-c", start, *map(str, files)]
        try:
            self._process = subprocess.Popen(
                [*command, json.dumps(_module_folders())],
                pass_fds=files,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
                env={name: value for name, value in os.environ.items() if name not in hidden},
            )
        except OSError as error:
            raise MachineryError(f"A process cannot be started: {error}.") from error
        finally:
            theirs.close()
            os.close(memory)

    def send(self, request: msgspec.Struct) -> None:
        """Send a request; whether the child still lives is found out elsewhere."""
        with suppress(OSError):
            self.channel.send(request)

    def receive(self) -> list[T]:
        """Read what has arrived; see `Channel.receive`."""
        return self.channel.receive()

    def death(self) -> str | None:
        """How the process ended, in words; None while it lives.

        Its exit code is left to be read again: until then its number, and with it that of its
        group, is nobody else's.
        """
        options = os.WEXITED | os.WNOHANG | os.WNOWAIT
        end = os.waitid(os.P_PID, self._process.pid, options)
        if end is None:
            return None
        if end.si_code == os.CLD_EXITED:
            return f"its process ended with exit code {end.si_status}."
        with suppress(ValueError):
            return f"its process was ended by {signal.Signals(end.si_status).name}."
        return f"its process was ended by signal {end.si_status}."

    def death_within(self, seconds: float) -> str | None:
        """How the process ended, in words, where it may take a moment to be seen."""
        deadline = time.monotonic() + seconds
        while (death := self.death()) is None and time.monotonic() < deadline:
            time.sleep(seconds / 100)
        return death

    def kill(self) -> None:
        """End the process and all of its group."""
        with suppress(OSError):
            os.killpg(self._process.pid, signal.SIGKILL)
        # A process that a driver keeps from dying is not waited for.
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(DEATH_S)
        self.channel.socket.close()


def _module_folders() -> list[str]:
    """Where modules are found here, absolute, and the current folder last.

    A module there must be found, but must not stand in for one of the standard library.
    """
    try:
        here = str(Path.cwd())
    except FileNotFoundError:  # it was deleted; relative entries lead nowhere
        return [entry for entry in sys.path if Path(entry).is_absolute()]
    folders = [str(Path(here, entry)) for entry in sys.path]
    return [folder for folder in folders if folder != here] + [here] * (here in folders)


class Parent(Channel[Any]):
    """The parent as a child sees it; without one there is no reason to go on."""

    def report(self, report: msgspec.Struct) -> None:
        """Tell the parent."""
        try:
            self.send(report)
        except OSError:
            end_group()


def run_child(connection: int, kind: Any, do: Callable[[Parent, Requests], None]) -> NoReturn:
    """What a child does until it is done, is asked to stop, or its parent is gone.

    Args:
        connection: File descriptor of its socket.
        kind: Type of the requests to it.
        do: What it is for; takes the parent and the requests from it.
    """
    signal.signal(signal.SIGINT, lambda _number, _frame: None)  # the parent's to handle
    parent = Parent(socket.socket(fileno=connection), kind)
    requests: Requests = queue.SimpleQueue()
    watch_parent(os.getppid(), end_group)
    threading.Thread(target=_listen, args=(parent, requests), daemon=True).start()
    try:
        do(parent, requests)
    except DuoBenchError as error:
        parent.report(Refused(error=type(error).__name__, message=escaped(str(error))))
    except BaseException as error:  # noqa: BLE001 - a process boundary; the parent raises it
        text = f"A process of the evaluation failed.\n{traceback_text(error)}"
        parent.report(Refused(error=EvaluationError.__name__, message=text))
    # Exit handlers are the policy's; taking the interpreter down is skipped: graphics drivers
    # have crashed there. The parent ends whatever is left.
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
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
