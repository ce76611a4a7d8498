"""A scripted operator at the page of trials, over the real socket."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from duobench.core.errors import DuoBenchError
from duobench.core.types import Side
from duobench.real.clock import Clock, VirtualClock
from duobench.real.duo import FrankaDuo
from duobench.real.opening import open_rig
from duobench.real.rig import Rig
from duobench.real.sessions.trials import TrialsSession
from duobench.real.sessions.trials_folder import TrialsFolder
from duobench.results.labels import FaultKind
from duobench.results.records import Judged, Record
from duobench.results.suite import TaskInfo, find_tasks
from duobench.web.page import assets
from duobench.web.server import PageServer
from tests.real.sessions import toys
from tests.real.simulated import simulated_rig
from tests.web.pages import Page, open_page, wait_until

STEPS = 20
"""Horizon of the episodes."""
LAST = 5
"""Stage that ends an episode."""
POLICIES = ((f"{toys.MODULE}:Patient", "sim"), (f"{toys.MODULE}:Keen", "mixed"))
"""Names of the policies, and what they were trained on."""
ONE = ((f"{toys.MODULE}:Patient", ""),)


def short_task(name: str = "bin_sort") -> TaskInfo:
    (task,) = find_tasks([name])
    return replace(task, horizon=STEPS)


class Operator:
    """What a person does at the page, and at the arms of a stand."""

    def __init__(self, page: Page, stand: Any = None) -> None:
        self.page = page
        self.stand: Stand = stand
        self.status: dict[str, Any] = {}
        self.say("drive")

    def say(self, kind: str, **fields: Any) -> None:
        self.page.say(kind=kind, **fields)

    def until(self, condition: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        """Read what the page is told until a status meets a condition, or the session fails."""
        while not (self.status and condition(self.status)):
            assert not self.stand or not self.stand.has_failed.is_set()
            message = self.page.hear()
            if message["kind"] == "status":
                self.status = message
        return self.status

    def phase(self, phase: str) -> dict[str, Any]:
        return self.until(lambda status: status["phase"] == phase)

    def start(self) -> None:
        """Place the objects of the next trial and start it."""
        self.phase("placing")
        self.say("placed")
        self.phase("ready")
        self.say("start")

    def begin(self) -> dict[str, Any]:
        """Place and start the next trial; its status while it plays."""
        self.start()
        return self.phase("playing")

    def trial(self, *stages: int) -> None:
        """Judge a whole trial, one stage a chunk, and close it."""
        self.begin()
        self.play([[stage] for stage in stages])
        self.finish()

    def press(self, stage: int | None) -> None:
        """Press a stage, or undo, and wait until the page says so."""
        count = len(self.status["presses"])
        if stage is None:
            self.say("undo")
        else:
            self.say("stage", stage=stage)
        self.until(lambda status: len(status["presses"]) == count + 1)

    def play(
        self, presses: Sequence[Sequence[int | None]], chunks: int = STEPS // toys.CHUNK
    ) -> dict[str, Any]:
        """Judge an episode chunk by chunk, until it is over; what the page says then."""
        for each in [*presses, *[()] * (chunks - len(presses))]:
            assert toys.Patient.waiting.acquire(timeout=toys.TIMEOUT_S)
            for stage in each:
                self.press(stage)
            toys.Patient.gate.release()
            if self.status["stage"] == len(self.status["stages"]):
                break
        return self.phase("judging")

    def next_chunk(self, act: Callable[[], object] = lambda: None) -> None:
        """Do something before the policy answers with its next chunk, which it then does."""
        assert toys.Patient.waiting.acquire(timeout=toys.TIMEOUT_S)
        act()
        toys.Patient.gate.release()

    def fail(self, side: Side, text: str, kind: FaultKind = FaultKind.CONTACT) -> None:
        """Let an arm have a fault."""
        self.stand.duo.arms[side].fail(text, kind)  # type: ignore[attr-defined]

    def fail_in_trial(self, stage: int, text: str, kind: FaultKind = FaultKind.CONTACT) -> None:
        """Begin a trial in which an arm has a fault after a stage was reached."""
        self.begin()
        self.press(stage)
        self.next_chunk()  # before the first command nothing counts
        self.next_chunk(lambda: self.fail(Side.LEFT, text, kind))

    def recover(self) -> None:
        """Clear a fault."""
        self.until(lambda status: status["fault"])
        self.say("recover")
        self.until(lambda status: not status["fault"])

    def wait_for_hold(self) -> None:
        wait_until(lambda: self.stand.duo.held is not None)

    def attempt(self, number: int) -> None:
        self.until(lambda status: status["trial"]["attempt"] == number)

    def finish(self, *, holds: bool = True) -> None:
        """Close the trial; of a solved one say first whether it held at the end."""
        before = self.status["trial"]
        if self.status["stage"] == len(self.status["stages"]):
            self.say("at_end", holds=holds)
        self.say("finish")
        self.until(lambda status: status["trial"] != before or status["phase"] == "over")

    def invalid(self, reason: str) -> None:
        before = self.status["trial"]
        self.say("invalid", reason=reason)
        self.until(lambda status: status["trial"] != before)


class Stand:
    """Simulated arms, a page and a folder, put together as `duobench real eval` does."""

    def __init__(
        self,
        path: Path,
        policies: Sequence[tuple[str, str]] = ONE,
        *,
        rig: Rig | None = None,
        task: TaskInfo | None = None,
        clock: Clock | None = None,
        **options: Any,
    ) -> None:
        self.folder = TrialsFolder(path)
        self.has_failed = threading.Event()
        self.ending = ExitStack()
        self.duo: FrankaDuo = open_rig(rig or simulated_rig(), clock or VirtualClock(), guard=False)
        self.ending.callback(self.duo.close)
        self.server = PageServer(assets("trials_page.html"))
        self.ending.callback(self.server.close)
        usual: dict[str, Any] = {"episodes": 1, "rater": "operator", "silence_s": 60.0}
        try:
            self.session = TrialsSession(
                self.folder,
                self.duo,
                task or short_task(),
                policies,
                self.server,
                self.ending,
                **usual | options,
            )
        except DuoBenchError:
            self.ending.close()
            raise


def records(folder: TrialsFolder) -> dict[str, list[Record]]:
    """The records of each policy, by its letter."""
    plan, found = folder.read_plan(), folder.run.read_records(folder.run.read_run())
    return {
        plan.letter(number): [each for each in found if each.policy == candidate.policy]
        for number, candidate in enumerate(plan.policies)
    }


@contextmanager
def operated(stand: Stand, script: Callable[[Operator], None]) -> Iterator[list[BaseException]]:
    """Have a script operate the page in a thread, as long as the block lasts."""
    failures: list[BaseException] = []

    def operate() -> None:
        try:
            with open_page(stand.server.url) as page:
                script(Operator(page, stand))
        except BaseException as error:  # noqa: BLE001 - told in the block's thread
            failures.append(error)
            stand.session.stop()
            toys.Patient.gate.release(100)

    thread = threading.Thread(target=operate)
    thread.start()
    try:
        yield failures
    except BaseException:
        stand.has_failed.set()
        raise
    finally:
        thread.join()


def run(
    stand: Stand,
    script: Callable[[Operator], None],
    report: Callable[[], dict[str, object]] = dict,
) -> bool:
    """Run a session that a script operates; whether nothing is missing at the end."""
    with operated(stand, script) as failures:
        is_complete = stand.session.run()
        stand.session.publish(**report())
    if failures:
        raise failures[0]
    return is_complete


def played(
    folder: Path,
    script: Callable[[Operator], None],
    policies: Sequence[tuple[str, str]] = ONE,
    *,
    is_complete: bool = True,
    **options: Any,
) -> Stand:
    """A stand at which a script has operated a session, of one episode by default."""
    stand = Stand(folder, policies, **options)
    with stand.ending:
        assert run(stand, script) == is_complete
    return stand


def trials(*stages: int) -> Callable[[Operator], None]:
    """A script of trials, each of which reaches a stage."""

    def script(operator: Operator) -> None:
        for stage in stages:
            operator.trial(stage)

    return script


def only_record(stand: Stand) -> tuple[Record, Judged]:
    ((record,),) = records(stand.folder).values()
    assert record.judged is not None
    return record, record.judged
