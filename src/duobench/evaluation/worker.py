"""A worker: a process of its own that plays episodes, and how its parent talks to it.

A worker leads a process group, in a session of its own. Its parent ends it as a group, and it ends
its group itself when its parent is gone, so that what a policy has started ends with it (unless
that has left the group, as a daemon does).
"""

from __future__ import annotations

import atexit
import json
import os
import queue
import secrets
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

from duobench.errors import (
    DuoBenchError,
    EvaluationError,
    MachineryError,
    escaped,
    traceback_text,
)
from duobench.evaluation.clock import EpisodeClock
from duobench.evaluation.episode import EpisodeRunner, Job
from duobench.evaluation.messages import (
    Channel,
    EpisodeError,
    Play,
    Progress,
    Ready,
    Refused,
    Report,
    Request,
    StartHost,
)
from duobench.evaluation.policies import PolicySource, find_source
from duobench.policy.serving import importing
from duobench.policy.serving.address import RemoteServer
from duobench.processes import watch_parent
from duobench.results.records import EpisodeRecord
from duobench.results.suite import Episode, TaskInfo

_HOST_WAIT_S = 5.0
"""Seconds to wait for a host that has said that it listens."""
DEATH_S = 10.0
"""How long a killed process is waited for, in seconds."""
_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[3]); "
    "from duobench.evaluation.worker import work; work(int(sys.argv[1]), int(sys.argv[2]))"
)


class Worker:
    """A worker as its parent sees it."""

    def __init__(self, job: Job) -> None:
        """Start the process and have it make the policy.

        Raises:
            MachineryError: The process cannot be started.
        """
        ours, theirs = socket.socketpair()
        self.channel: Channel[Report] = Channel(ours, Report)  # pyright: ignore[reportArgumentType]
        """The connection to it."""
        memory = os.memfd_create("duobench-clock")
        os.ftruncate(memory, EpisodeClock.SIZE)
        self.clock = EpisodeClock(memory)
        """What its policy is doing."""
        self.is_ready = False
        """Whether it has made the policy."""
        self.episode: Episode | None = None
        """What it is playing."""
        self.progress: EpisodeRecord | None = None
        """The record of that so far, once it has begun."""
        self.task: TaskInfo | None = None
        """The task whose environment it has."""
        files = (theirs.fileno(), memory)
        # In safe mode (-P), the current folder does not come before the standard library.
        flags = subprocess._args_from_interpreter_flags()  # pyright: ignore[reportAttributeAccessIssue]
        command = [sys.executable, *flags, "-P", "-c", _START, *map(str, files)]
        try:
            self._process = subprocess.Popen(
                [*command, json.dumps(_module_folders())],
                pass_fds=files,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        except OSError as error:
            raise MachineryError(f"A worker cannot be started: {error}.") from error
        finally:
            theirs.close()
            os.close(memory)
        self.send(job)

    def send(self, request: Request) -> None:
        """Send a request; whether the worker still lives is found out elsewhere."""
        with suppress(OSError):
            self.channel.send(request)

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


def work(connection: int, clock: int) -> None:
    """What a worker process does until it is asked to stop or its parent is gone.

    Args:
        connection: File descriptor of its socket.
        clock: File descriptor of its clock.
    """
    signal.signal(signal.SIGINT, lambda _number, _frame: None)  # the parent's to handle
    channel: Channel[Request] = Channel(socket.socket(fileno=connection), Request)  # pyright: ignore[reportArgumentType]
    requests: queue.SimpleQueue[Request] = queue.SimpleQueue()
    watch_parent(os.getppid(), _end_group)
    threading.Thread(target=_listen, args=(channel, requests), daemon=True).start()
    try:
        _serve(channel, requests, EpisodeClock(clock))
    except DuoBenchError as error:
        _report(channel, Refused(error=type(error).__name__, message=escaped(str(error))))
    except BaseException as error:  # noqa: BLE001 - a process boundary; the parent raises it
        text = f"A worker failed.\n{traceback_text(error)}"
        _report(channel, Refused(error=EvaluationError.__name__, message=text))
    # Exit handlers are the policy's; taking the interpreter down is skipped: graphics drivers
    # have crashed there. The parent ends whatever is left.
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def _serve(
    channel: Channel[Request], requests: queue.SimpleQueue[Request], clock: EpisodeClock
) -> None:
    """Make the policy, then play one episode after the other."""
    job = requests.get()
    if not isinstance(job, Job):
        return
    source = find_source(job.policy, job.suite.tasks, job.limits)
    if source.batch_policy is not None:
        _host(channel, requests, clock, source)
        return
    runner = EpisodeRunner(
        source,
        job,
        clock,
        lambda record: _report(channel, Progress(record=record)),
        is_interruptible=False,
    )
    _report(channel, Ready(run=runner.run, versions=runner.versions))
    while isinstance(request := requests.get(), Play):
        try:
            report = runner.play(request.episode)
        except MachineryError as fault:
            report = EpisodeError(fault=escaped(str(fault)))
        _report(channel, report)
    runner.close()


def _host(
    channel: Channel[Request],
    requests: queue.SimpleQueue[Request],
    clock: EpisodeClock,
    source: PolicySource,
) -> None:
    """Serve a policy to other workers, on this machine and with a key that only they have."""
    with importing():
        from duobench.policy.serving.host import PolicyHost
    if source.batch_policy is None or source.batching is None:
        raise AssertionError("Only a batch policy is hosted.")
    key = secrets.token_urlsafe()
    host = PolicyHost(
        source.batch_policy, source.metadata, source.batching, key=key, busy=clock.answering
    )
    threading.Thread(target=lambda: (requests.get(), host.stop()), daemon=True).start()
    url = f"ws://127.0.0.1:{host.port}"
    _report(channel, StartHost(server=RemoteServer(url=url, key=key, wait_s=_HOST_WAIT_S)))
    host.run()


def _report(channel: Channel[Request], report: Report) -> None:
    """Tell the parent; without one there is no reason to be here."""
    try:
        channel.send(report)
    except OSError:
        _end_group()


def _end_group() -> None:
    """End this process and all that it has started."""
    os.killpg(0, signal.SIGKILL)


def _listen(channel: Channel[Request], requests: queue.SimpleQueue[Request]) -> None:
    """Pass requests on; when the parent has closed the connection, end the group at once."""
    with suppress(EOFError, OSError):
        while True:
            for request in channel.receive():
                requests.put(request)
    _end_group()
