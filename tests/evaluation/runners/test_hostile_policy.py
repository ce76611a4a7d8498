"""A policy whose process sends its parent what it should not; nothing crashes or grows."""

import itertools
import os
import random
import re
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from duobench.core.errors import (
    DuoBenchError,
    EvaluationError,
    MessageError,
    PolicyError,
    UnknownNameError,
    error_class,
)
from duobench.core.versions import __version__
from duobench.evaluation.runners import process, ray_process
from duobench.evaluation.runners.process import Channel, ProcessFailed, Stop
from duobench.evaluation.runners.ray_process import AUTH_MODE, TOKEN, RemoteProcess
from tests.evaluation import toy_tasks

ROOT = Path(__file__).parents[3]
MOST_GROWTH = 20 << 20
"""Bytes by which the parent may grow."""
TIMEOUT_S = 120
POLLS, STARTING = 5, 300
SCRIPT = """
import resource, sys
from pathlib import Path
from duobench.core.errors import DuoBenchError
from duobench.results.folder import RunFolder
from duobench.evaluation.runners.evaluations import evaluate
from tests.evaluation import toy_tasks
from tests.evaluation.conftest import small_suite

def memory():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10

def play(policy, name):
    try:
        folder = RunFolder(Path(sys.argv[1], name))
        results = evaluate(policy, small_suite(episodes=1), folder, workers=1)
        print(*{record.reason for one in results.tasks for record in one.records})
    except DuoBenchError as error:
        print(type(error).__name__, error)

play("hold", "hold")
before = memory()
play(f"{toy_tasks.__name__}:Floods", "floods")
print(memory() - before)
"""


UNREADABLE = r"what it sent cannot be read \(.*\)\."
UNASKED = r"it sent an unrequested message\."


@pytest.mark.long
@pytest.mark.parametrize(
    ("when", "kind", "fault"),
    [
        *((when, "junk", UNREADABLE) for when in ("made", "plays")),
        *(("plays", kind, UNREADABLE) for kind in ("deep", "empty", "endless")),
        ("made", "fails", None),
        ("plays", "fails", UNASKED),
        *((when, "answers", UNASKED) for when in ("made", "plays")),
    ],
)
def test_flood_from_a_policy_ends_its_process_and_costs_its_parent_little(
    tmp_path: Path, when: str, kind: str, fault: str | None
) -> None:
    script = tmp_path / "play.py"
    script.write_text(SCRIPT)
    folders = os.pathsep.join([str(ROOT / "src"), str(ROOT)])
    flood = {toy_tasks.FLOOD: f"{when} {kind}", toy_tasks.MARKS: str(tmp_path)}
    ended = subprocess.run(
        [sys.executable, str(script), str(tmp_path)],
        env={**os.environ, "PYTHONPATH": folders, **flood},
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert "Traceback" not in ended.stdout + ended.stderr
    assert len(ended.stderr.splitlines()) < 20
    _, said, growth = ended.stdout.splitlines()
    assert int(growth) < MOST_GROWTH
    if fault is None:
        assert said == r"EvaluationError \x1b[31m"
    elif when == "made":
        assert re.fullmatch(rf"MachineryError 3 workers in a row .*: {fault}", said)
    else:
        assert re.fullmatch(rf"PolicyEndedError: In 2 attempts .*: {fault}", said)


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("PolicyError", PolicyError),
        ("UnknownNameError", UnknownNameError),
        *((name, EvaluationError) for name in ("annotations", "Any", "escaped", "sys", "", "\0")),
    ],
)
def test_error_from_outside_is_one_of_the_family(name: str, found: type[DuoBenchError]) -> None:
    assert error_class(name) is found


def test_message_is_read_up_to_its_most_bytes() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        sender, receiver = Channel(theirs, Stop), Channel(ours, ProcessFailed, most=1 << 15)
        sender.send(ProcessFailed("PolicyError", "a" * (1 << 14)))
        assert len(receiver.receive()) == 1
        theirs.sendall(b" " * ((1 << 15) + 1))
        with pytest.raises(MessageError, match="more than 32768 bytes"):
            receiver.receive()


@pytest.mark.parametrize(
    ("kind", "death"), [("endless", "more than 65536 bytes"), ("answers", None), ("junk", "JSON")]
)
def test_actor_passes_on_no_more_than_fits(
    monkeypatch: pytest.MonkeyPatch, kind: str, death: str | None
) -> None:
    """A poll of a process that sends without an end comes back, with little in it."""
    monkeypatch.setenv(toy_tasks.FLOOD, f"actor {kind}")
    monkeypatch.setenv(AUTH_MODE, TOKEN)
    monkeypatch.setattr(ray_process, "load", lambda: FakeRay)
    monkeypatch.setattr(ray_process, "POLICY_BYTES", 1 << 16)
    actor = RemoteProcess(__name__, __version__, is_reached=True)
    assert actor._process is not None
    try:
        statuses = [actor.poll()]
        silent = 0  # while its process starts, however busy the machine is
        while statuses[-1].death is None and len(statuses) < POLLS + silent < POLLS + STARTING:
            statuses.append(actor.poll())
            silent += not any(status.messages for status in statuses)
    finally:
        actor._process.kill()
    sizes = [sum(map(len, status.messages)) for status in statuses]
    assert 0 < max(sizes) < (1 << 16) + process._PIECE or kind != "answers"
    if death is None:
        assert len(statuses) == POLLS + silent
    else:
        assert death in str(statuses[-1].death)


class FakeRay:
    """Of Ray, what an actor asks for its node."""

    util: type["FakeRay"]

    @staticmethod
    def get_runtime_context() -> type["FakeRay"]:
        return FakeRay

    @staticmethod
    def get_node_ip_address() -> str:
        return "127.0.0.1"

    @staticmethod
    def get_node_id() -> str:
        return "node"


FakeRay.util = FakeRay


def main(connection: int, _clock: int, _host: str) -> None:
    """What the actor's process runs: it sends for ever."""
    some, kind = random.Random(0), os.environ[toy_tasks.FLOOD].split()[1]
    with suppress(OSError):
        for k in itertools.count():
            os.write(connection, toy_tasks.FLOODS[kind](some, k))
