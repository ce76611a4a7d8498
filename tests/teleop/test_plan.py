"""A plan of tasks and layouts: what comes next follows from the data set alone."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.core.errors import DuoBenchError
from duobench.core.randomness import TRAIN, episode_seed
from duobench.core.spatial import SE3
from duobench.data import Actor, DataSet, Recording, summarize
from duobench.tasks import catalog
from duobench.teleop.hands import HandDevice
from duobench.teleop.plan import Plan, PlannedSessions
from duobench.teleop.teleoperation import DISCARDED, KEPT, Teleoperation, TeleopState, make_recorder
from tests.docs.markdown import page_of, text_of
from tests.teleop.operator import hand, message
from tests.teleop.test_session import PERSON, Desk
from tests.web.pages import Page, open_page

TASKS = ("carry_pot", "bin_sort")
PLAN = "carry_pot,bin_sort x 2"


class PlanDesk(Desk):
    """Sessions of a plan, whose episodes are over after a moment, and a clock."""

    def __init__(self, folder: Path, plan: str = PLAN) -> None:
        device = HandDevice()
        wanted = Plan.parse(plan)

        def make(task: str, actor: Actor) -> Teleoperation:
            env = make_recorder(task, folder, actor, time_limit_s=0.2)
            return Teleoperation(
                env, device, episodes=wanted.layouts, times=wanted.times, tasks=wanted.ids
            )

        self.turn = 0
        self.plan = PlannedSessions(wanted, DataSet.open(folder), make, PERSON)
        self.next()

    def next(self) -> bool:
        """Open the session of the next task, if there is one."""
        session = self.plan.next()
        if session is not None:
            self.session = session
        return session is not None

    def take(self, answer: str = "keep") -> None:
        """Lead an episode to its end, and decide about it."""
        self.leave()
        self.begin()
        while self.state is TeleopState.RECORDING:
            self.send(left=1, right=1, devices=("mouse",))
        self.say(answer)

    def items(self) -> dict[str, str]:
        return {each["id"]: each["detail"] for each in self.plan.items()}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("11x50", (catalog.names(), 50, 1)),
        ("2 x 3 x 4", (catalog.names()[:2], 3, 4)),
        ("bin_sort,carry_pot x 20", (("bin_sort", "carry_pot"), 20, 1)),
        ("bin_sort x20x2", (("bin_sort",), 20, 2)),
    ],
)
def test_a_plan_says_tasks_layouts_and_how_often(
    text: str, expected: tuple[tuple[str, ...], int, int]
) -> None:
    plan = Plan.parse(text)
    assert (plan.tasks, plan.layouts, plan.times) == expected


@pytest.mark.parametrize("page", ["people", "teleoperation"])
def test_plans_of_pages_are_plans(page: str) -> None:
    found = re.findall(r"--plan (?:\"([^\"]+)\"|(\S+))", text_of(page_of(page)))
    assert found
    for quoted, word in found:
        assert Plan.parse(quoted or word).layouts > 1


def test_in_each_round_of_the_protocol_every_layout_is_led_once(tmp_path: Path) -> None:
    desk = PlanDesk(tmp_path, "carry_pot x 2 x 2")
    seen = []
    for answer in ("discard", "keep", "keep", "keep", "keep"):
        seen.append(desk.session._layout)
        desk.take(answer)
    assert seen == [0, 1, 0, 1, 0]
    assert desk.state is TeleopState.OVER
    desk.plan.__exit__(None)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "A plan is TASKS x LAYOUTS"),
        ("50", "A plan is TASKS x LAYOUTS"),
        ("bin_sort", "A plan is TASKS x LAYOUTS"),
        ("bin_sort x many", "A plan is TASKS x LAYOUTS"),
        ("bin_sort x 1 x 2 x 3", "Unknown task"),
        ("12x50", "11 tasks, got 12"),
        ("0x50", "11 tasks, got 0"),
        ("11x0", "at least one episode"),
        (", x 5", "at least one task"),
        ("11 x 99999999999", "at most 10,000 layouts"),
        ("11 x 5 x 99999999999", "at most 10,000 layouts"),
        (f"11 x {'9' * 5000}", "A plan is TASKS x LAYOUTS"),
        ("bin_sort,bin_sort x 2", "once, got bin_sort twice"),
        ("bin_srot x 2", "bin_sort"),
    ],
)
def test_what_is_no_plan_is_said(text: str, complaint: str) -> None:
    with pytest.raises(DuoBenchError, match=complaint):
        Plan.parse(text)


def test_two_operators_lead_a_plan_and_given_up_layouts_come_back(tmp_path: Path) -> None:
    desk = PlanDesk(tmp_path)
    assert desk.items() == {"carry_pot": "0 of 2", "bin_sort": "0 of 2"}
    desk.say("discard")  # layout 0, before it began
    desk.take()
    assert (desk.state, desk.status("kept"), desk.status("count")) == ("waiting", 1, 2)
    desk.take()  # layout 0 again
    assert (desk.state, desk.next()) == ("over", True)
    assert desk.items() == {"carry_pot": "2 of 2 · P07 2", "bin_sort": "0 of 2"}
    desk.say("operator", name="P08")
    desk.take()
    desk.take("discard")
    assert desk.items()["bin_sort"] == "1 of 2 · P08 1"
    with desk.plan:  # ends the program; the same command goes on
        pass
    again = PlanDesk(tmp_path)
    assert (again.status("task"), again.status("kept"), again.status("count")) == ("bin_sort", 1, 2)
    assert again.status("operators") == ["P08"]
    assert again.plan.operators == ["P07", "P08"]
    again.take()
    assert not again.next()
    found = {
        (info.task, info.seed, info.actor)
        for info in map(Recording.read_info, DataSet(tmp_path).episodes())
    }
    p08 = replace(PERSON, name="P08")
    assert found == {
        ("carry_pot", episode_seed("carry_pot", 0, TRAIN), PERSON),
        ("carry_pot", episode_seed("carry_pot", 1, TRAIN), PERSON),
        ("bin_sort", episode_seed("bin_sort", 0, TRAIN), p08),
        ("bin_sort", episode_seed("bin_sort", 1, TRAIN), PERSON),
    }
    summary = summarize(DataSet(tmp_path))
    takes = {(led.task, led.operator, led.device): led.begun for led in summary.leading}
    assert takes == {
        ("bin_sort", "person P07", "mouse"): 1,
        ("bin_sort", "person P08", "mouse"): 2,  # one was discarded
        ("carry_pot", "person P07", "mouse"): 2,
    }
    bins, pots = summary.tasks
    assert bins.attempted == "3 begun, 2 of them kept"
    assert pots.attempted == "2 begun, 2 of them kept"
    bigger = PlanDesk(tmp_path, "carry_pot x 2 x 2")
    assert (bigger.status("kept"), bigger.status("wanted")) == (2, 4)
    bigger.plan.__exit__(None)


def test_a_task_that_the_operator_chooses_comes_next_and_discarded_takes_wait(
    tmp_path: Path,
) -> None:
    desk = PlanDesk(tmp_path)
    desk.take("discard")
    desk.say("select", id="transfer_cube")  # not of the plan
    assert desk.state is TeleopState.WAITING
    desk.say("select", id="bin_sort")
    assert (desk.state, desk.next(), desk.status("task")) == ("over", True, "bin_sort")
    desk.begin()
    desk.say("select", id="carry_pot")
    assert desk.state is TeleopState.RECORDING
    assert "comes next" in desk.session.note
    desk.say("discard")
    assert (desk.state, desk.next(), desk.status("task")) == ("over", True, "carry_pot")
    assert desk.status("discarded") == 1
    desk.say("restore")
    desk.say("keep")
    assert desk.status("count") == 1
    desk.take()
    assert desk.state is TeleopState.OVER
    assert desk.items()["carry_pot"] == "2 of 2 · P07 2"
    desk.plan.__exit__(None)


def test_kept_is_said_before_the_next_layout_is_prepared(tmp_path: Path) -> None:
    desk = PlanDesk(tmp_path)
    said = []
    desk.session.before_reset = lambda: said.append(
        (desk.state, desk.status("note"), desk.status("kept"), desk.status("step") > 0)
    )
    desk.take()
    desk.take("discard")
    assert said == [
        (TeleopState.PREPARING, KEPT, 1, True),
        (TeleopState.PREPARING, DISCARDED, 1, True),
    ]
    desk.plan.__exit__(None)


def test_who_leads_from_a_take_over_on_is_in_the_rows(tmp_path: Path) -> None:
    desk = PlanDesk(tmp_path)
    desk.begin()
    desk.send(left=1, devices=("mouse",))
    desk.leave()
    desk.say("operator", name="P08")
    desk.send()
    desk.send(left=1, devices=("headset",), turns=20)
    (partial,) = DataSet(tmp_path).partials()
    left = partial.read_bytes()
    desk.say("discard")
    desk.say("restore")
    desk.say("keep")
    (recording,) = DataSet(tmp_path).recordings()
    p08 = replace(PERSON, name="P08", device="headset")
    assert recording.info.leaders == (replace(PERSON, device="mouse"), p08)
    assert [recording.info.actors[each].name for each in recording.leader[[0, 1, -2, -1]]] == [
        "P07",
        "P07",
        "P08",
        "P08",
    ]
    assert desk.status("operator") == "P08"
    desk.plan.__exit__(None)
    copy = DataSet.open(tmp_path / "copy").partial("carry_pot", "00000")
    copy.parent.mkdir(parents=True)
    copy.write_bytes(left)
    recovered = Recording.read(DataSet(tmp_path / "copy").recover(copy))
    assert [each.name for each in recovered.info.actors] == ["P07", "P08"]
    assert recovered.info.actor.device == "mouse"


@contextmanager
def command(folder: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """`duobench teleop` with the plan, which is killed if it does not end."""
    words = [sys.executable, "-m", "duobench", "teleop", "--plan", PLAN, "--out", str(folder)]
    words += ["--scripted", "--lockstep", *options]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as it:
        try:
            yield it
        finally:
            it.kill()


def opened(process: subprocess.Popen[str], ending: ExitStack) -> Page:
    """The page of a session, which drives."""
    assert process.stdout
    page = ending.enter_context(open_page(process.stdout.readline().split()[-1]))
    page.drive()
    return page


def begin(page: Page) -> None:
    """Open both hands, and lead an arm for some steps."""
    for number in range(30):
        one = hand(SE3.at(z=0.001 * number), squeeze=float(number > 0))
        page.say(**json.loads(message(number, one, None, devices=["gamepad"])))
    page.hear_of("status", step=29)


@pytest.mark.slow
def test_two_processes_lead_different_tasks_and_a_killed_one_loses_nothing(tmp_path: Path) -> None:
    with ExitStack() as ending:
        first = ending.enter_context(command(tmp_path, "--operator", "P07"))
        page = opened(first, ending)
        begin(page)
        second = ending.enter_context(command(tmp_path, "--operator", "P08"))
        other = opened(second, ending)
        items = other.hear_of("items")["items"]
        details = {each["id"]: each["detail"] for each in items}
        other.hear_of("status", task="bin_sort", operator="P08")
        assert details == {"carry_pot": "0 of 2 · led in another session", "bin_sort": "0 of 2"}
        third = ending.enter_context(command(tmp_path))
        said, _ = third.communicate(timeout=120)
        assert third.returncode == 1
        assert "All that is left is led in another session: carry_pot, bin_sort" in said
        first.kill()
        first.wait()
        data = DataSet.open(tmp_path)
        (partial,) = [path for path in data.partials() if path.parent.name == "carry_pot"]
        actor = Recording.read(data.recover(partial)).info.actor
        assert (actor.name, actor.device) == ("P07", "gamepad")
        again = ending.enter_context(command(tmp_path))
        page = opened(again, ending)
        status = page.hear_of("status", task="carry_pot", count=1)
        assert (status["kept"], status["wanted"]) == (0, 2)
        again.send_signal(signal.SIGINT)
        said, _ = again.communicate(timeout=120)
        assert "0 episodes of carry_pot" in said
