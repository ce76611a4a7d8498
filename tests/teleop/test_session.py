from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.cli.shared.leading import LeadingOptions
from duobench.core.errors import OptionError
from duobench.core.randomness import TRAIN, episode_seed
from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.data import Actor, ActorKind, DataSet, Recording, leading
from duobench.envs.sim_env import sim_of
from duobench.evaluation.replay.takes import Recorded
from duobench.teleop.hands import HandDevice
from duobench.teleop.teleoperation import (
    LIMIT,
    LOSS,
    TIME_LIMIT_S,
    Teleoperation,
    TeleopState,
    make_recorder,
)
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import ROBOT
from tests.teleop.operator import HOMES, NEITHER, Operator, hand, led, message, said

TASK = "carry_pot"
PERSON = Actor(kind=ActorKind.PERSON, name="P07", device="mouse")
UP = np.array([0.0, 0.0, 0.1])


class Desk:
    """A session and a clock; messages are sent as if thirty a second came over a quick line."""

    def __init__(
        self,
        folder: Path | None,
        *,
        time_limit_s: float = 180.0,
        lockstep: bool = False,
        **more: Any,
    ) -> None:
        env = make_recorder(TASK, folder, PERSON, time_limit_s=time_limit_s)
        device = HandDevice(lockstep=lockstep)
        self.session = Teleoperation(env, device, lockstep=lockstep, **more)
        self.turn = 0

    @property
    def now(self) -> float:
        return self.turn / CONTROL_HZ

    @property
    def state(self) -> TeleopState:
        return self.session.state

    def status(self, name: str) -> Any:
        return self.session.status()[name]

    def send(
        self,
        left: float = 0.0,
        right: float = 0.0,
        shift: Any = 0.0,
        turns: int = 1,
        devices: tuple[str, ...] = (),
        **more: Any,
    ) -> None:
        """In each of some turns, both hands at their homes and a shift, squeezed as far as said."""
        squeezes = {Side.LEFT: left, Side.RIGHT: right}
        for _ in range(turns):
            hands = [
                hand(HOMES[side].moved(*(shift * np.ones(3))), squeeze=squeezes[side], **more)
                for side in SIDES
            ]
            self.session.receive(said(message(self.turn, *hands, devices=devices)), self.now)
            self.wait()

    def wait(self, turns: int = 1) -> None:
        for _ in range(turns):
            self.session.advance(self.now)
            self.turn += 1

    def say(self, kind: str, **fields: Any) -> None:
        self.session.receive(said(json.dumps({"kind": kind, **fields})), self.now)
        self.wait()

    def bring_back(self) -> str:
        """Restore what was discarded last, and keep it; what the session says then."""
        self.say("restore")
        assert self.state is TeleopState.DECIDE
        self.session.receive(said('{"kind": "keep"}'), self.now)
        self.session._handle()
        return self.session.note

    def leave(self) -> None:
        self.session.leave(self.now)

    def begin(self) -> None:
        """Open both hands and squeeze them."""
        self.send()
        self.send(left=1, right=1)
        assert self.state is TeleopState.RECORDING

    def rise(self, turns: int) -> None:
        """Raise both hands by `UP` in twenty turns."""
        for number in range(turns):
            self.send(left=1, right=1, shift=UP * min(1.0, number / 20))

    def solve(self) -> None:
        """Lead the episode that waits to its end, which is a decision to take."""
        operator = Operator(self.session, number=10_000 + self.turn)  # its clock goes on from ours
        while self.state is not TeleopState.DECIDE:
            self.session.receive(said(operator.next_message()), self.now)
            self.wait()

    def tools(self) -> dict[Side, SE3]:
        """Where the tools are commanded to be."""
        return Kinematics(ROBOT).forward(self.session.env.base.backend.last_command.joints)

    def is_at(self, places: dict[Side, SE3], tolerance: float) -> bool:
        tools = self.tools()
        return all(tools[side].distance(places[side])[0] < tolerance for side in SIDES)

    def openings(self) -> list[float]:
        return self.session.env.base.backend.last_command.openings.tolist()

    def recordings(self) -> list[Recording]:
        data = self.session.env.data
        assert data is not None
        return list(data.recordings())


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    made = Desk(tmp_path)
    yield made
    made.session.close()


def test_nothing_moves_before_both_hands_were_open_and_one_is_squeezed(desk: Desk) -> None:
    session = desk.session
    start = session.env.state_hash()
    desk.wait()
    assert "Waiting for the operator" in session.note
    desk.send(left=1)
    desk.send(left=1, right=1)
    assert "Open both hands" in session.note
    desk.send(trigger=1.0)
    assert "Open both hands" in session.note
    desk.send()
    assert session.note == "Lead a tool to begin."
    assert session.env.state_hash() == start
    assert desk.status("clutch") == NEITHER
    desk.send(right=1)
    assert (desk.state, desk.status("step")) == (TeleopState.RECORDING, 1)
    assert desk.status("clutch") == led(right=True)


def test_hands_that_rise_lift_the_tools_by_as_much(desk: Desk) -> None:
    before = desk.tools()
    desk.begin()
    desk.rise(60)
    there = desk.tools()
    for side in SIDES:
        moved = there[side].translation - before[side].translation
        assert moved == pytest.approx(UP, abs=2e-4)
        assert there[side].distance(before[side])[1] < 1e-3
    desk.send(shift=UP, turns=10)
    desk.send(turns=10)
    desk.send(left=1, right=1, turns=10)
    assert desk.is_at(there, 2e-4)


def test_a_stall_opens_the_clutches_and_its_burst_moves_nothing(desk: Desk) -> None:
    desk.begin()
    desk.wait(7)
    assert desk.status("clutch")["left"]
    desk.wait(3)
    assert not desk.status("clutch")["left"]
    still = desk.tools()
    desk.wait(round(4 * CONTROL_HZ))
    hands = [hand(HOMES[side].moved(z=0.3), squeeze=1.0) for side in SIDES]
    for number in range(12, desk.turn - 8):
        desk.session.receive(said(message(number, *hands)), desk.now)
    desk.wait()
    assert desk.status("lost") > 90
    desk.send(left=1, right=1, shift=UP, turns=10)
    assert desk.is_at(still, 1e-4)
    desk.send()
    desk.send(left=1)
    assert desk.status("clutch") == led(left=True)


def test_a_driver_who_leaves_lets_go_and_the_next_one_has_another_clock(desk: Desk) -> None:
    desk.begin()
    desk.leave()
    desk.wait()
    assert desk.status("clutch") == NEITHER
    for squeeze in (0.0, 1.0):
        open_hand = hand(HOMES[Side.LEFT], squeeze=squeeze)
        data = message(int(squeeze), open_hand, None, sent=5.0 + 33.0 * squeeze)
        desk.session.receive(said(data), desk.now)
        desk.wait()
    assert desk.status("clutch") == led(left=True)


def test_an_arm_that_is_let_go_stays_where_it_was_led_last(desk: Desk) -> None:
    desk.begin()
    desk.send(turns=2)  # both rest here, before they are led elsewhere
    desk.rise(30)
    there = desk.tools()
    desk.say("recentre")
    desk.send(left=1, right=1, shift=UP, turns=10)
    assert desk.status("clutch") == NEITHER
    desk.leave()
    desk.send(turns=10)
    assert desk.is_at(there, 1e-3)


def test_a_recording_waits_for_a_driver_who_has_gone(desk: Desk) -> None:
    desk.begin()
    desk.send(left=1, right=1, trigger=0.75)
    step, before = desk.status("step"), desk.session.env.state_hash()
    desk.leave()
    desk.wait(100)
    assert (desk.state, desk.status("step")) == (TeleopState.PAUSED, step)
    assert "No operator drives" in desk.status("note")
    assert desk.session.env.state_hash() == before
    desk.send(left=1, right=1, shift=UP)
    assert (desk.state, desk.status("step")) == (TeleopState.RECORDING, step + 1)
    assert (desk.status("note"), desk.status("clutch")) == ("", NEITHER)
    desk.leave()
    desk.say("discard")
    assert desk.state is TeleopState.WAITING
    assert desk.recordings() == []


def test_a_recording_waits_for_a_driver_who_is_not_heard_of(desk: Desk) -> None:
    desk.begin()
    desk.wait(round(0.9 * CONTROL_HZ))
    assert desk.state is TeleopState.RECORDING
    desk.wait(round(0.2 * CONTROL_HZ))
    step = desk.status("step")
    desk.wait(100)
    assert (desk.state, desk.status("step")) == (TeleopState.PAUSED, step)
    desk.send()
    assert desk.state is TeleopState.RECORDING


def test_a_pause_leaves_no_gap(desk: Desk) -> None:
    desk.begin()
    for _ in range(3):
        desk.leave()
        desk.wait(50)
        desk.send()
        desk.send(left=1)
    desk.session.close()
    (recording,) = desk.recordings()
    assert len(recording) == 7
    np.testing.assert_allclose(np.diff(recording.time), 1 / CONTROL_HZ)
    assert recording.clutch[1:].tolist() == 3 * [[False, False], [True, False]]


def test_the_world_stands_still_while_nobody_leads_and_goes_on_without_a_jump(desk: Desk) -> None:
    desk.begin()
    desk.rise(30)
    led = desk.status("step")
    desk.send(turns=90)
    stood = desk.status("step")
    assert led + 15 <= stood <= led + 60
    before, there = desk.session.env.state_hash(), desk.tools()
    desk.send(shift=3 * UP, turns=300)
    assert (desk.status("pace"), desk.status("step")) == ("standing", stood)
    assert (desk.state, desk.status("led_s")) == (TeleopState.RECORDING, round(stood / 30, 1))
    assert desk.session.env.state_hash() == before
    desk.send(left=1, right=1, shift=3 * UP, turns=10)
    assert (desk.status("pace"), desk.status("step")) == ("led", stood + 10)
    assert desk.is_at(there, 1e-4)
    led_s = desk.status("led_s")
    desk.session.close()
    data = desk.session.env.data
    assert data is not None
    (path,), (recording,) = data.episodes(), desk.recordings()
    np.testing.assert_allclose(np.diff(recording.time), 1 / CONTROL_HZ)
    take = leading.LedEpisode.of(recording)
    assert take is not None
    seconds = (Recorded.read(path).take(data.reviews).led_s, take.led_s)
    assert seconds == pytest.approx((led_s, led_s), abs=0.05), "one number on all pages"


def test_the_world_runs_alone_at_the_operators_word(desk: Desk) -> None:
    desk.say("alone")
    assert not desk.status("alone"), "nothing runs before the episode"
    desk.begin()
    desk.send(turns=60)
    assert desk.status("pace") == "standing"
    step = desk.status("step")
    desk.say("alone")
    desk.send(turns=30)
    assert (desk.status("pace"), desk.status("step")) == ("alone", step + 31)
    desk.say("alone")
    desk.send(turns=30)
    assert (desk.status("alone"), desk.status("step")) == (False, step + 31)


def test_a_trigger_leads_its_gripper_while_the_clutch_is_open(desk: Desk) -> None:
    desk.begin()
    desk.send(turns=60)
    step = desk.status("step")
    desk.send(trigger=1.0, turns=90)
    assert desk.status("step") > step + 20
    assert max(desk.session.env.base.backend.read().openings) < 0.1
    assert desk.status("pace") == "standing"


def test_what_falls_is_recorded_until_it_rests(desk: Desk) -> None:
    desk.begin()
    simulation = sim_of(desk.session.env).simulation
    simulation.place("pot", simulation.pose("pot").moved(z=0.3))
    simulation.forward()
    step = desk.status("step")
    desk.send(turns=100)
    assert step + 20 < desk.status("step") <= step + 91
    assert simulation.is_settled(0.2)


def test_the_end_of_the_time_is_said_before_it_comes(tmp_path: Path) -> None:
    desk = Desk(tmp_path, time_limit_s=11.0)
    desk.begin()
    desk.send(left=1, right=1, turns=28)
    assert (desk.status("limit_s"), desk.status("note")) == (11.0, "")
    desk.send(left=1, right=1)
    assert "10 s are left" in desk.status("note")
    desk.send(turns=1000)
    assert desk.state is TeleopState.RECORDING, "thinking is not counted"
    desk.send()
    desk.send(left=1, right=1, turns=300)
    assert desk.state is TeleopState.DECIDE
    assert "Time is up" in desk.status("note")
    desk.session.close()


def test_a_gripper_follows_its_trigger_once_it_was_moved(desk: Desk) -> None:
    desk.begin()
    desk.send(left=1, right=1, trigger=0.75)
    assert desk.openings() == [0.25, 0.25]
    desk.wait(10)  # lost: what was held stays held, whatever the trigger says when it comes back
    desk.send(trigger=0.0, turns=5)
    assert desk.openings() == [0.25, 0.25]
    desk.send(trigger=0.5)
    assert desk.openings() == [0.5, 0.5]


def test_an_episode_is_solved_kept_and_followed_by_the_next(tmp_path: Path) -> None:
    desk = Desk(tmp_path, episodes=2)
    desk.solve()
    assert desk.status("success")
    assert desk.session.env.data is not None
    assert not desk.session.env.data.episodes()
    desk.say("keep")
    assert (desk.state, desk.session.kept, desk.status("count")) == (TeleopState.WAITING, 1, 1)
    desk.session.close()
    again = Desk(tmp_path, episodes=2, instruction="Carry it!")
    assert again.session.kept == 1
    again.solve()
    again.say("keep")
    assert again.state is TeleopState.OVER
    for number, recording in enumerate(again.recordings()):
        info = recording.info
        wording = "Carry it!" if number else info.task_instruction
        assert (info.seed, info.split, info.actor, info.instruction) == (
            episode_seed(TASK, number, TRAIN),
            TRAIN,
            PERSON,
            wording,
        )
        assert recording.clutch.shape == (len(recording), 2)
        assert recording.success_step == len(recording) - CONTROL_HZ
    again.session.close()


def test_a_discarded_episode_is_no_episode_and_the_next_begins(desk: Desk) -> None:
    desk.begin()
    desk.say("keep")
    assert "not solved" in desk.session.note
    desk.say("discard")
    assert (desk.state, desk.status("count")) == (TeleopState.WAITING, 1)
    assert not desk.recordings()
    desk.say("discard")
    assert (desk.status("count"), desk.session.kept, desk.status("discarded")) == (2, 0, 1)


def test_what_is_kept_at_success_is_kept_at_the_end(tmp_path: Path) -> None:
    desk = Desk(tmp_path, episodes=1)
    operator = Operator(desk.session)
    while desk.state is not TeleopState.OVER:
        assert desk.state is not TeleopState.DECIDE
        hands = said(operator.next_message())
        if desk.state is TeleopState.SUCCESS:
            desk.session.receive(said('{"kind": "keep"}'), desk.now)
        desk.session.receive(hands, desk.now)
        desk.wait()
    (recording,) = desk.recordings()
    assert recording.success_step == len(recording) - CONTROL_HZ
    desk.session.close()


def test_a_button_counts_once_for_each_press(desk: Desk) -> None:
    pressed = {"keep": False, "discard": True, "restore": False, "recentre": False}
    desk.send(buttons=pressed, turns=5)
    assert desk.status("count") == 0  # it was pressed when the session began
    desk.send()
    desk.send(buttons=pressed, turns=5)
    assert desk.status("count") == 1


@pytest.mark.parametrize("is_kept", [True, False])
def test_an_episode_that_takes_too_long_is_no_success_but_may_be_kept(
    tmp_path: Path, is_kept: bool
) -> None:
    desk = Desk(tmp_path, time_limit_s=0.2, episodes=1)
    desk.begin()
    desk.send(turns=6)
    assert (desk.state, desk.status("success")) == (TeleopState.DECIDE, False)
    assert "Time is up" in desk.session.note
    if is_kept:
        desk.say("keep")
    desk.session.close()
    (recording,) = desk.recordings()
    outcome = recording.info.outcome
    assert outcome is not None
    assert (outcome.success, outcome.kept, outcome.cut) == (False, is_kept, False)
    assert is_kept or "whether to keep" in str(outcome.reason)  # nobody decided about it


def test_an_instruction_that_is_typed_is_that_of_the_episode_that_waits(desk: Desk) -> None:
    own, typed = desk.status("instruction"), "Lift the pot together."
    start = desk.session.env.base.backend.read().flat
    desk.say("instruction", text=typed)
    assert desk.status("instruction") == typed
    np.testing.assert_array_equal(desk.session.env.base.backend.read().flat, start)
    desk.begin()
    desk.say("instruction", text="")
    assert desk.status("instruction") == typed
    desk.session.env.finish()
    desk.session.env.keep()
    (recording,) = desk.recordings()
    assert (recording.info.instruction, recording.info.task_instruction) == (typed, own)
    desk.say("discard")
    assert desk.status("instruction") == own


@pytest.mark.parametrize(
    ("said_by_page", "expected"),
    [
        ([("mouse",)], "mouse"),
        ([("gamepad",)], "gamepad"),
        ([("headset",)], "headset"),
        ([("gamepad",), (), ("mouse", "gamepad")], "mouse and gamepad"),
        ([()], "mouse"),  # a page that does not say it: who leads has
    ],
)
def test_the_device_is_what_the_page_led_with(
    desk: Desk, said_by_page: list[tuple[str, ...]], expected: str
) -> None:
    desk.send(left=1, devices=("headset",))  # before the episode, nothing follows
    desk.send(devices=("headset",) if expected == "headset" else ())
    desk.send(left=1, right=1, devices=said_by_page[0])
    for devices in said_by_page[1:]:
        desk.send(left=1, right=1, devices=devices)
    desk.say("discard")
    desk.send(left=1, devices=("headset",))
    desk.bring_back()
    (recording,) = desk.recordings()
    assert recording.info.actor == replace(PERSON, device=expected)


def test_a_device_that_led_before_is_not_that_of_the_next_episode(desk: Desk) -> None:
    for devices in (("headset",), ("gamepad",)):
        desk.send()
        desk.send(left=1, right=1, devices=devices)
        desk.say("discard")
        desk.bring_back()
    assert [each.info.actor.device for each in desk.recordings()] == ["headset", "gamepad"]


def test_a_killed_write_of_an_episode_is_recovered_whatever_led_it(
    desk: Desk, tmp_path: Path
) -> None:
    desk.send()
    desk.send(left=1, devices=("gamepad",), turns=20)
    data = DataSet(tmp_path)
    (partial,) = data.partials()
    left = partial.read_bytes()
    desk.session.close()
    partial.write_bytes(left)  # killed after the episode was written
    assert Recording.read(data.recover(partial)).info.actor.device == "gamepad"
    assert data.partials() == []


def test_the_newest_executed_sample_is_named(desk: Desk) -> None:
    device = desk.session.device
    desk.send()
    assert math.isnan(device.executed_ms)
    desk.send(left=1)
    assert device.executed_ms == pytest.approx(1000.0 / CONTROL_HZ)
    desk.say("discard")
    assert math.isnan(device.executed_ms)


def test_in_lockstep_a_message_is_a_step_however_late_it_comes() -> None:
    desk = Desk(None, lockstep=True)
    desk.send()
    desk.turn += 1000
    desk.send(left=1)
    for number in range(5):
        desk.session.receive(said(message(0, *(hand(HOMES[side]) for side in SIDES))), 0.0)
        assert desk.status("step") == 1 + number
        desk.wait(2)
    desk.session.close()


def test_hands_are_told_what_they_cannot_see(desk: Desk) -> None:
    desk.begin()
    for number in range(40):
        desk.send(left=1, right=1, shift=UP * number)
    assert set(desk.session.haptics.take()) == {(side, *LIMIT) for side in SIDES}
    desk.wait(10)
    assert desk.session.haptics.take() == [(side, *LOSS) for side in SIDES]


def test_a_session_says_what_it_needs() -> None:
    env = make_recorder(TASK, None, PERSON, action_mode="joint")
    with pytest.raises(OptionError, match="'cartesian'"):
        Teleoperation(env, HandDevice())
    with pytest.raises(OptionError, match="1 to 10,000 episodes"):
        Teleoperation(env, HandDevice(), episodes=0)
    env.close()
    for limit_s in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(OptionError, match="at least one control step"):
            make_recorder(TASK, None, PERSON, time_limit_s=limit_s)
    assert LeadingOptions().limit == TIME_LIMIT_S


def test_a_killed_session_leaves_an_episode_that_can_be_recovered(desk: Desk) -> None:
    desk.begin()
    desk.send(left=1, turns=20)
    data = desk.session.env.data
    assert data is not None
    (partial,) = data.partials()
    copy = DataSet.open(data.path.parent / "copy").partial(TASK, "x")
    copy.parent.mkdir(parents=True)
    copy.write_bytes(partial.read_bytes())
    recording = Recording.read(DataSet(data.path.parent / "copy").recover(copy))
    assert recording.clutch.tolist() == [[True, True]] + [[True, False]] * (len(recording) - 1)
