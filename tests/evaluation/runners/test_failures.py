"""Each failure is of whom the page says: every cell of its table is raised here, by real parts."""

import os
import signal
import struct
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgpack
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection

from docs.failures import (
    AGAIN,
    ASIDE,
    ENDS,
    FAILED,
    NOTHING,
    ROWS,
    STOPS,
    TWICE,
    UNPLAYED,
    Row,
)
from duobench.core.errors import (
    DuoBenchError,
    MachineryError,
    OutputError,
    UnplayedError,
)
from duobench.evaluation.policies import PolicyChoice
from duobench.policy.serving.codec import pack, unpack
from duobench.policy.serving.connection import is_healthy
from duobench.policy.serving.limits import HEALTH_PATH, reply_bytes
from duobench.results.folder import RunFolder
from duobench.results.records import Record
from duobench.results.run import Resuming, TimeLimits
from duobench.results.suite import find_tasks
from tests.evaluation import toy_batches, toy_tasks
from tests.evaluation.processes import wait_until
from tests.evaluation.runners import toy_failures
from tests.evaluation.runners.toy_failures import BAD, WHAT
from tests.evaluation.toy_tasks import seed_of
from tests.policy.serving.serving import free_port, listening, server_at, start_server

WAIT_S = 20.0
TASKS = f"{toy_failures.__name__}:"
LATE = TimeLimits(act_timeout=2.0)


@dataclass(frozen=True, kw_only=True)
class Case:
    """What is played so that one cell happens."""

    policy: str = f"{toy_failures.__name__}:Fails"
    serving: Callable[[], AbstractContextManager[int]] | None = None
    """Serves the policy at a port."""
    wait_s: float = WAIT_S
    tasks: Sequence[str] = (toy_tasks.WAVE_NAME,)
    bad: Sequence[tuple[str, int]] = (("wave", BAD),)
    """The episodes that it happens in, all if there are none."""
    workers: int = 1
    environment: Mapping[str, str] = field(default_factory=dict[str, str])
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    says: str = ""
    """A part of the message."""
    meanwhile: Callable[[Path], None] = lambda _folder: None
    """Done to the folder once an episode is finished."""


# --- servers ------------------------------------------------------------------------------------

HANDSHAKE: dict[str, Any] = {
    "protocol": 1, "name": "evil", "cameras": [], "version": "1", "batch": "fixed", "max_batch": 1,
}  # fmt: skip
Evil = Callable[[ServerConnection], None]


@contextmanager
def evil_server(
    evil: Evil, when: Callable[[int, int], bool] | None = None, *, lives: bool = True
) -> Iterator[int]:
    """Hold, but do something in place of one answer of the bad episode."""
    names = iter([HANDSHAKE["name"], "other"])
    told = {"name": next(names)}

    def is_bad(seed: int, acts: int) -> bool:
        return seed == seed_of("wave", BAD) and acts == 2

    def serve(connection: ServerConnection) -> None:
        seed = acts = 0
        OPEN.add(connection)
        with suppress(ConnectionClosed, OSError):
            connection.send(pack({"duobench": HANDSHAKE | told}))
            for frame in connection:
                request = unpack(bytes(frame))
                if request.get("endpoint") == "reset":
                    seed, acts = request["seed"], 0
                    connection.send(pack({"status": "reset successful"}))
                    continue
                acts += 1
                if (when or is_bad)(seed, acts):
                    evil(connection)
                    if evil is becomes_another:
                        told["name"] = "other"
                else:
                    connection.send(pack({"actions": request["agent_pos"][None]}))
        OPEN.discard(connection)

    def admit(connection: ServerConnection, request: Request) -> Response | None:
        if request.path != HEALTH_PATH:
            return None
        return connection.respond(200 if lives else 503, "")

    with listening(serve, process_request=admit) as port:
        yield port


def sends(data: bytes | str) -> Evil:
    return lambda connection: connection.send(data)


def array(**wrong: Any) -> bytes:
    fields: dict[str, Any] = {
        "__ndarray__": True,
        "data": bytes(64),
        "dtype": "<f4",
        "shape": [1, 16],
    }
    return msgpack.packb({"actions": fields | wrong})


def writes(data: bytes) -> Evil:
    """Write bytes past the protocol."""

    def write(connection: ServerConnection) -> None:
        connection.socket.sendall(data)
        time.sleep(0.2)

    return write


def half_a_frame(connection: ServerConnection) -> None:
    connection.socket.sendall(b"\x82\x7e\x01\x00half")
    connection.socket.close()


def closes(code: int) -> Evil:
    return lambda connection: connection.close(code)


def becomes_another(connection: ServerConnection) -> None:
    connection.close(1011)


def two_answers(connection: ServerConnection) -> None:
    for _ in range(2):
        connection.send(array())


def closes_all(connection: ServerConnection) -> None:
    """What the end of a server does to all of its clients."""
    OPEN.discard(connection)
    time.sleep(0.3)
    for each in (*OPEN, connection):
        each.close(1011)


OPEN: set[ServerConnection] = set()


def is_late(_connection: ServerConnection) -> None:
    time.sleep(4.0)


EVIL: Mapping[str, Evil] = {
    "bfloat16": sends(array(dtype="bfloat16", data=bytes(32))),
    "objects": sends(array(dtype="|O")),
    "complex": sends(array(dtype="<c8", shape=[1, 8])),
    "extension": sends(msgpack.packb({"actions": msgpack.ExtType(5, bytes(4))})),
    "lying shape": sends(array(shape=[2**40, 16])),
    "nested": sends(b"\x91" * 1000),
    "noise": sends(b"\xc1\xff\x00"),
    "empty": sends(b""),
    "bad frame": writes(b"\xf2\x01x"),
    "bad text": writes(b"\x81\x02\xff\xfe"),
    "too large": sends(bytes(reply_bytes(None) + 1)),
    "two answers": two_answers,
    "too wide": sends(array(shape=[1, 8], dtype="<f8")),
    "not a number": sends(array(data=struct.pack("<16f", *[float("nan")] * 16))),
    "no array": sends(msgpack.packb({"actions": "none"})),
    "raises": sends("ZeroDivisionError: on purpose"),
    "late": is_late,
    "closes": lambda connection: connection.close(),
    "closes with 1011": closes(1011),
    "closes all": closes_all,
    "half a frame": half_a_frame,
    "late and silent": is_late,
    "is another": becomes_another,
    "is busy": closes(1013),
}


def evil(name: str, **options: Any) -> Callable[[], AbstractContextManager[int]]:
    return lambda: evil_server(EVIL[name], **options)


def first(_seed: int, _acts: int) -> bool:
    return True


def at_no_time(_seed: int, _acts: int) -> bool:
    return False


@contextmanager
def supervised(*, again: bool = True) -> Iterator[int]:
    """A `duobench serve` in a process of its own, started again whenever it has ended."""
    port, is_over = free_port(), threading.Event()
    running = [start_server(toy_failures.Fails, port)]

    def supervise() -> None:
        while not is_over.wait(0.1):
            if again and running[-1].poll() is not None:
                running.append(start_server(toy_failures.Fails, port))

    thread = threading.Thread(target=supervise)
    thread.start()
    try:
        wait_until(lambda: is_healthy(server_at(port)), "a server")
        yield port
    finally:
        is_over.set()
        thread.join()
        running[-1].kill()
        for each in running:
            each.wait()


def no_server() -> AbstractContextManager[int]:
    """Something else than a policy's server answers."""
    return listening(lambda connection: connection.send("hello"))


# --- cells --------------------------------------------------------------------------------------


def local(name: str, **changes: Any) -> Case:
    return Case(**{"environment": {WHAT: name}} | changes)


def served(name: str, **changes: Any) -> Case:
    return Case(**{"serving": evil(name)} | changes)


def at_server(name: str, **changes: Any) -> Case:
    return Case(**{"serving": supervised, "environment": {WHAT: name}} | changes)


def task(name: str, *bad: int, **changes: Any) -> Case:
    """Two tasks, of which the first has failed in some episodes, or in all."""
    reference = f"{TASKS}{name}"
    (found,) = find_tasks([reference])
    episodes = [(found.id, index) for index in (bad or range(3))]
    return Case(
        **{
            "policy": "hold", "tasks": (reference, toy_tasks.WAVE_NAME), "bad": episodes,
            "says": f"task '{found.id}' itself failed",
        } | changes
    )  # fmt: skip


def unrenderable(says: str = "", policy: str = "hold", **environment: str) -> Case:
    options = {"videos": 3} if policy == "hold" else {}
    return Case(policy=policy, environment=environment, bad=(), options=options, says=says)


LOOKS = f"{toy_failures.__name__}:Looks"
EMPTY = {"MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": ""}
SLIP = "a slip in my task"


def spoil(folder: Path) -> None:
    """Leave no place for more records."""
    records = folder / "records" / "wave"
    records.rename(folder / "elsewhere")
    records.touch()


def interrupt(_folder: Path) -> None:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(1.0)


CASES: Mapping[str, Case] = {
    "local: cannot be made": Case(policy=f"{TASKS}cannot_be_made", says="no weights"),
    "local: expects no camera": Case(policy=f"{TASKS}Elsewhere", says="haed"),
    "served: is no server": Case(serving=no_server, wait_s=0.0, says="no policy's server"),
    "local: dies when made": Case(policy=f"{TASKS}dies_when_made", says="3 workers in a row"),
    "local: raises first": local("raises first", says="on purpose"),
    "served: raises first": served("raises", serving=evil("raises", when=first), says="on purpose"),
    "local: ends first": local("ends first", says="first observation"),
    "served: ends first": served(
        "closes", serving=evil("closes", when=first), says="first observation"
    ),
    "local: too wide first": local("too wide first", says="17"),
    "served: too wide first": served("too wide", serving=evil("too wide", when=first), says="8"),
    "local: raises": local("raises", says="on purpose"),
    "served: raises": at_server("raises", says="on purpose"),
    "local: raises in reset": local("raises in reset", says="on purpose"),
    "served: raises in reset": at_server("raises in reset", says="on purpose"),
    "local: exits": local("exits", says="SystemExit"),
    "served: exits": at_server("exits", says="SystemExit"),
    "local: says machinery": local("says machinery", says="not my fault"),
    "served: says machinery": at_server("says machinery", says="not my fault"),
    "here: says machinery": local("says machinery", workers=0, says="not my fault"),
    "here: raises": local("raises", workers=0, says="on purpose"),
    "batched: raises": Case(
        policy=f"{toy_batches.__name__}:Breaks", bad=(("wave", 0), ("wave", 1)), says="broken"
    ),
    "local: too wide": local("too wide", says="17"),
    "served: too wide": served("too wide", says="8"),
    "local: not a number": local("not a number", says="nan"),
    "served: not a number": served("not a number", says="nan"),
    "local: no array": local("no array", says="array of numbers"),
    "served: no array": served("no array", says="array of numbers"),
    **{
        f"served: {name}": served(name, says="sends what cannot be read")
        for name in (
            "bfloat16",
            "objects",
            "complex",
            "extension",
            "lying shape",
            "nested",
            "noise",
            "empty",
            "bad frame",
            "bad text",
            "too large",
            "two answers",
        )
    },
    "local: bad frame": local("bad frame", says="sends what cannot be read"),
    "local: late": local("late", options={"limits": LATE}, says="did not answer within"),
    "served: late": served("late", options={"limits": LATE}, says="did not answer within"),
    "local: dies": local("dies", says="In 2 attempts the policy's process ended"),
    "served: dies": at_server("dies", says="In 2 attempts the connection to the policy was lost"),
    "local: dies beside another": local("dies beside another", workers=2, says="In 2 attempts"),
    "served: dies beside another": at_server(
        "dies beside another", workers=2, says="In 2 attempts"
    ),
    "served: closes": served("closes", says="In 2 attempts"),
    "served: closes with 1011": served("closes with 1011", says="In 2 attempts"),
    "served: half a frame": served("half a frame", says="In 2 attempts"),
    "served: late and silent": served(
        "late", serving=evil("late", lives=False), options={"limits": LATE}, says="In 2 attempts"
    ),
    "here: closes with 1011": served("closes with 1011", workers=0, says="In 2 attempts"),
    "local: closes files": local("closes files", says="cannot be reached"),
    "local: dies once": local("dies once"),
    "served: dies once": at_server("dies once"),
    "served: is gone": at_server(
        "dies", serving=lambda: supervised(again=False), wait_s=1.0, says="cannot be reached"
    ),
    "served: is another": served("is another", says="another policy now"),
    "served: is busy": served("is busy", says="try again later"),
    "here: diverges": local("diverges", workers=0, says="The physics engine warned"),
    "local: no rotation": Case(policy=f"{TASKS}Turns", says="no orientation"),
    "task: object raises": task("OBJECT", says=SLIP),
    "task: misspelt name": task("NAME"),
    "task: arrange raises": task("ARRANGE", says=SLIP),
    "task: accept raises in one": task("ACCEPT", BAD, says=SLIP),
    "task: accept raises here": task("ACCEPT", BAD, workers=0, says=SLIP),
    "task: no valid layout": task("NOWHERE", says="accepts none"),
    "task: counted as failures": task(
        "ACCEPT", BAD, options={"resuming": Resuming(unplayed_count_as_failures=True)}
    ),
    "task: stage raises": task("STAGE", says=SLIP),
    "task: stage raises here": task("STAGE", workers=0),
    "task: words raise": task("WORDS", says=SLIP),
    "task: words find nothing": task("NEXT"),
    "task: stage blames others": task("LOST", says="not my fault"),
    "task: stage blames others here": task("LOST", workers=0, says="not my fault"),
    "task: stage raises, served": task("STAGE", serving=evil("raises", when=at_no_time)),
    "simulator: dies": Case(
        policy="hold",
        tasks=(toy_tasks.NOD_NAME,),
        bad=(("nod", 1),),
        says="SIGKILL",
        environment={toy_tasks.MISBEHAVIOUR: "dies_in_one"},
    ),
    "video: device is empty": unrenderable(**EMPTY),
    "video: device is a list": unrenderable(**EMPTY | {"MUJOCO_EGL_DEVICE_ID": "0,1"}),
    "video: device is a name": unrenderable(**EMPTY | {"MUJOCO_EGL_DEVICE_ID": "GPU-1b2c"}),
    "video: no such device": unrenderable(**EMPTY | {"MUJOCO_EGL_DEVICE_ID": "77"}),
    "video: no such library": unrenderable(MUJOCO_GL="none"),
    "images: device is empty": unrenderable(policy=LOOKS, **EMPTY),
    "images: no such library": unrenderable(policy=LOOKS, MUJOCO_GL="none"),
    "disk: cannot be written": Case(policy="hold", bad=(), meanwhile=spoil),
    "person: interrupts": Case(policy="hold", bad=(), meanwhile=interrupt),
}
QUICK = {
    "local: raises first", "here: raises", "served: bfloat16", "here: diverges",
    "task: stage raises here",
    "video: device is empty", "images: device is empty",
}  # fmt: skip
REPEATED = ("local", "video")
"""Places whose cells end like those of others: by the rule of a served policy, of an image."""


def mark_of(cell: str) -> tuple[pytest.MarkDecorator, ...]:
    if cell in QUICK:
        return ()
    return (pytest.mark.long if cell.startswith(REPEATED) else pytest.mark.slow,)


CELLS = [
    pytest.param(row, cell, id=cell, marks=mark_of(cell)) for row in ROWS for cell in row.cells
]


def test_every_cell_is_raised_and_served_policies_are_treated_as_local_ones() -> None:
    cells = [cell for row in ROWS for cell in row.cells]
    assert sorted(cells) == sorted(CASES)
    assert len(cells) >= 30
    for row in ROWS:
        for cell in row.cells:
            where, _, name = cell.partition(": ")
            other = f"{'served' if where == 'local' else 'local'}: {name}"
            assert where not in ("local", "served") or other not in CASES or other in row.cells


@dataclass(frozen=True)
class Meanwhile:
    """Does something whenever an episode is finished."""

    do: Callable[[], None]

    def on_run_start(self, run: Any, finished: Any) -> None:
        """Wait for an episode."""

    def on_episode(self, played: Any) -> None:  # noqa: ARG002 - any
        self.do()


@pytest.mark.parametrize(("row", "cell"), CELLS)
def test_failure_is_of_whom_the_page_says(
    play: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, row: Row, cell: str
) -> None:
    case, folder = CASES[cell], RunFolder(tmp_path / "run")
    for name, value in case.environment.items():
        monkeypatch.setenv(name, value)
    options = {"episodes": 3, "tasks": find_tasks(case.tasks), "workers": case.workers}
    options["observers"] = [Meanwhile(lambda: case.meanwhile(folder.path))]
    raised: BaseException | None = None
    with ExitStack() as serving:
        policy: Any = case.policy
        if case.serving is not None:
            port = serving.enter_context(case.serving())
            server = server_at(port, wait_s=case.wait_s)
            policy = PolicyChoice(name="openpi", server=server)
        try:
            play(policy, **options | case.options)
        except (DuoBenchError, KeyboardInterrupt) as error:
            raised = error
    assert_effect(row.effect, case, folder, raised)
    said = str(raised or "")
    if row.effect in (FAILED, TWICE):
        said = "\n".join(record.error or "" for record in records(folder).values())
    assert case.says in said


@pytest.mark.long
def test_episode_is_alone_until_it_ends_after_a_policy_of_several_was_lost(
    play: Any, tmp_path: Path
) -> None:
    def is_bad(seed: int, acts: int) -> bool:
        time.sleep(0.02)
        return seed == seed_of("wave", 6) and acts == 2

    with evil_server(closes_all, is_bad) as port:
        server = server_at(port, wait_s=WAIT_S)
        play(PolicyChoice(name="openpi", server=server), workers=2, episodes=12)
    found = records(RunFolder(tmp_path / "run"))
    bad = found.pop(("wave", 6))
    assert bad.earlier in (("policy",), ("shared policy", "policy"))
    assert bad.error is not None
    assert all(each.error is None for each in found.values())
    marked = sum(bool(each.earlier) for each in found.values())
    assert marked == len(bad.earlier) - 1


def records(folder: RunFolder) -> dict[tuple[str, int], Record]:
    if not folder.description.exists():
        return {}
    found = folder.read_records(folder.read_run())
    return {(each.task, each.episode): each for each in found}


def assert_effect(effect: str, case: Case, folder: RunFolder, raised: BaseException | None) -> None:
    found = records(folder)
    failed = {key for key, record in found.items() if record.error}
    everything = {(each.id, k) for each in find_tasks(case.tasks) for k in range(3)}
    bad = set(case.bad)
    if effect in (FAILED, TWICE):
        assert raised is None
        assert (found.keys(), failed) == (everything, bad)
        again = {key for key, record in found.items() if "policy" in record.earlier}
        assert again == (bad if effect == TWICE else set())
    elif effect == AGAIN:
        assert raised is None
        assert (found.keys(), failed) == (everything, set())
        assert {key for key, record in found.items() if record.earlier} == bad
    elif effect in (UNPLAYED, ASIDE):
        assert isinstance(raised, UnplayedError)
        assert (found.keys(), failed) == (everything - bad, set())
        assert all(f"{name}, episode {index}" in str(raised) for name, index in bad)
    elif effect == NOTHING:
        assert isinstance(raised, DuoBenchError)
        assert not folder.description.exists()
    elif effect == ENDS:
        assert isinstance(raised, MachineryError)
        assert "Traceback" not in str(raised)
        assert (failed, found.keys() & (bad or everything)) == (set(), set())
    else:
        assert effect == STOPS
        assert isinstance(raised, OutputError | KeyboardInterrupt)
        assert not failed
        assert len(found) < len(everything)
