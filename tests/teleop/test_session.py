from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.data import Actor, ActorKind, DataSet, Recording
from duobench.errors import MessageError, OptionError
from duobench.kinematics.inverse import Kinematics
from duobench.randomness import TRAIN, episode_seed
from duobench.rig_sessions.teleoperation import Teleoperation, TeleopState, make_recorder
from duobench.spatial import SE3
from duobench.teleop.hands import HandDevice
from duobench.types import CONTROL_HZ, SIDES, Side
from tests.teleop.operator import Operator, hand, message

TASK = "carry_pot"
PERSON = Actor(kind=ActorKind.PERSON, name="P07", device="mouse")
HOMES = {Side.LEFT: SE3.at(0.1, 0.2, 0.3), Side.RIGHT: SE3.at(0.1, -0.2, 0.3)}
UP = np.array([0.0, 0.0, 0.1])


class Desk:
    """A session and a clock; messages are sent as if thirty a second came over a quick line."""

    def __init__(self, folder: Path | None, *, lockstep: bool = False, **options: Any) -> None:
        recorder = {name: options.pop(name) for name in ("time_limit_s",) if name in options}
        env = make_recorder(TASK, folder, PERSON, **recorder)
        self.session = Teleoperation(
            env, HandDevice(lockstep=lockstep), lockstep=lockstep, **options
        )
        self.turn = 0

    @property
    def now(self) -> float:
        return self.turn / CONTROL_HZ

    def send(self, left: float = 0.0, right: float = 0.0, shift: Any = 0.0, **more: Any) -> None:
        """Both hands at their homes and a shift, squeezed as far as said; then one turn."""
        squeezes = {Side.LEFT: left, Side.RIGHT: right}
        hands = [
            hand(HOMES[side].moved(*(shift * np.ones(3))), squeeze=squeezes[side], **more)
            for side in SIDES
        ]
        self.session.receive(message(self.turn, *hands), self.now)
        self.wait()

    def wait(self, turns: int = 1) -> None:
        for _ in range(turns):
            self.session.advance(self.now)
            self.turn += 1

    def say(self, kind: str, **fields: Any) -> None:
        text = ", ".join(f'"{name}": "{value}"' for name, value in {"kind": kind, **fields}.items())
        self.session.receive(f"{{{text}}}", self.now)
        self.wait()

    def begin(self) -> None:
        """Open both hands and squeeze them."""
        self.send()
        self.send(left=1, right=1)
        assert self.session.state is TeleopState.RECORDING

    def tools(self) -> dict[Side, SE3]:
        """Where the tools are commanded to be."""
        return Kinematics().forward(self.session.env.base.backend.last_command.joints)

    def recordings(self) -> list[Recording]:
        data = self.session.env.data
        assert data is not None
        return list(data.recordings())


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    made = Desk(tmp_path)
    yield made
    made.session.close()


def solve(desk: Desk) -> None:
    """Lead the episode that waits to its end, which is a decision to take."""
    operator = Operator(desk.session)
    operator._number = 10_000 + desk.turn  # its clock goes on from ours
    while desk.session.state is not TeleopState.DECIDE:
        desk.session.receive(operator.next_message(), desk.now)
        desk.wait()


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
    assert "Squeeze" in session.note
    assert session.env.state_hash() == start
    assert session.status()["clutch"] == {"left": False, "right": False}
    desk.send(right=1)
    assert (session.state, session.status()["step"]) == (TeleopState.RECORDING, 1)
    assert session.status()["clutch"] == {"left": False, "right": True}


def test_hands_that_rise_lift_the_tools_by_as_much(desk: Desk) -> None:
    before = desk.tools()
    desk.begin()
    for number in range(60):
        desk.send(left=1, right=1, shift=UP * min(1.0, number / 20))
    there = desk.tools()
    for side in SIDES:
        moved = there[side].translation - before[side].translation
        assert moved == pytest.approx(UP, abs=2e-4)
        assert there[side].distance(before[side])[1] < 1e-3
    for _ in range(10):
        desk.send(shift=UP)
    for _ in range(10):
        desk.send()
    for _ in range(10):
        desk.send(left=1, right=1)
    for side, tool in desk.tools().items():
        assert tool.distance(there[side])[0] < 2e-4


def test_a_stall_opens_the_clutches_and_its_burst_moves_nothing(desk: Desk) -> None:
    desk.begin()
    desk.wait(7)
    assert desk.session.status()["clutch"]["left"]
    desk.wait(3)
    assert not desk.session.status()["clutch"]["left"]
    still = desk.tools()
    late = desk.now + 4.0
    while desk.now < late:
        desk.wait()
    hands = [hand(HOMES[side].moved(z=0.3), squeeze=1.0) for side in SIDES]
    for number in range(12, desk.turn - 8):
        desk.session.receive(message(number, *hands), desk.now)
    desk.wait()
    assert desk.session.status()["lost"] > 90
    for _ in range(10):
        desk.send(left=1, right=1, shift=UP)
    for side, tool in desk.tools().items():
        assert tool.distance(still[side])[0] < 1e-4
    desk.send()
    desk.send(left=1)
    assert desk.session.status()["clutch"] == {"left": True, "right": False}


def test_a_driver_who_leaves_lets_go_and_the_next_one_has_another_clock(desk: Desk) -> None:
    desk.begin()
    desk.session.leave(desk.now)
    desk.wait()
    assert desk.session.status()["clutch"] == {"left": False, "right": False}
    for squeeze in (0.0, 1.0):
        open_hand = hand(HOMES[Side.LEFT], squeeze=squeeze)
        data = message(int(squeeze), open_hand, None, sent=5.0 + 33.0 * squeeze)
        desk.session.receive(data, desk.now)
        desk.wait()
    assert desk.session.status()["clutch"] == {"left": True, "right": False}


def test_an_arm_that_is_let_go_stays_where_it_was_led_last(desk: Desk) -> None:
    desk.begin()
    desk.send()
    desk.send()  # both rest here, before they are led elsewhere
    for number in range(30):
        desk.send(left=1, right=1, shift=UP * min(1.0, number / 20))
    there = desk.tools()
    desk.say("recentre")
    for _ in range(10):
        desk.send(left=1, right=1, shift=UP)
    desk.session.leave(desk.now)
    for _ in range(10):
        desk.send()
    for side, tool in desk.tools().items():
        assert tool.distance(there[side])[0] < 1e-3


def test_a_recording_waits_for_a_driver_who_has_gone(desk: Desk) -> None:
    desk.begin()
    desk.send(left=1, right=1, trigger=0.75)
    session, step = desk.session, desk.session.status()["step"]
    before = session.env.state_hash()
    session.leave(desk.now)
    desk.wait(100)
    assert session.state is TeleopState.PAUSED
    assert "Nobody drives" in session.status()["note"]
    assert session.status()["step"] == step
    assert session.env.state_hash() == before
    desk.send(left=1, right=1, shift=UP)
    assert session.state is TeleopState.RECORDING
    assert session.status()["note"] == ""
    assert session.status()["step"] == step + 1
    assert session.status()["clutch"] == {"left": False, "right": False}
    session.leave(desk.now)
    desk.say("discard")
    assert session.state is TeleopState.WAITING
    assert desk.recordings() == []


def test_a_recording_waits_for_a_driver_who_is_not_heard_of(desk: Desk) -> None:
    desk.begin()
    desk.wait(round(0.9 * CONTROL_HZ))
    assert desk.session.state is TeleopState.RECORDING
    desk.wait(round(0.2 * CONTROL_HZ))
    step = desk.session.status()["step"]
    desk.wait(100)
    assert (desk.session.state, desk.session.status()["step"]) == (TeleopState.PAUSED, step)
    desk.send()
    assert desk.session.state is TeleopState.RECORDING


def test_a_pause_leaves_no_gap(desk: Desk) -> None:
    desk.begin()
    for _ in range(3):
        desk.session.leave(desk.now)
        desk.wait(50)
        desk.send()
        desk.send(left=1)
    desk.session.close()
    (recording,) = desk.recordings()
    assert len(recording) == 7
    np.testing.assert_allclose(np.diff(recording.time), 1 / CONTROL_HZ)
    assert recording.clutch[1:].tolist() == 3 * [[False, False], [True, False]]


def test_recentre_lets_both_hands_go(desk: Desk) -> None:
    desk.begin()
    desk.say("recentre")
    desk.send(left=1, right=1, shift=UP)
    assert desk.session.status()["clutch"] == {"left": False, "right": False}


def test_a_gripper_follows_its_trigger_once_it_was_moved(desk: Desk) -> None:
    desk.begin()
    backend = desk.session.env.base.backend
    desk.send(left=1, right=1, trigger=0.75)
    assert backend.last_command.openings.tolist() == [0.25, 0.25]
    desk.wait(10)  # lost: what was held stays held, whatever the trigger says when it comes back
    for _ in range(5):
        desk.send(trigger=0.0)
    assert backend.last_command.openings.tolist() == [0.25, 0.25]
    desk.send(trigger=0.5)
    assert backend.last_command.openings.tolist() == [0.5, 0.5]


def test_an_episode_is_solved_kept_and_followed_by_the_next(tmp_path: Path) -> None:
    desk = Desk(tmp_path, episodes=2)
    session = desk.session
    solve(desk)
    assert session.status()["success"]
    assert not session.env.data.episodes()  # type: ignore[union-attr]
    desk.say("keep")
    assert (session.state, session.kept, session.status()["count"]) == (TeleopState.WAITING, 1, 1)
    session.close()
    again = Desk(tmp_path, episodes=2, instruction="Carry it!")
    assert again.session.kept == 1
    solve(again)
    again.say("keep")
    assert again.session.state is TeleopState.OVER
    for number, recording in enumerate(again.recordings()):
        info = recording.info
        assert (info.seed, info.split) == (episode_seed(TASK, number, TRAIN), TRAIN)
        assert info.actor == PERSON
        assert info.instruction == ("Carry it!" if number else info.task_instruction)
        assert recording.clutch.shape == (len(recording), 2)
        assert recording.success_step == len(recording) - CONTROL_HZ
    again.session.close()


def test_a_discarded_episode_leaves_nothing_and_the_next_begins(desk: Desk) -> None:
    desk.begin()
    desk.say("keep")
    assert "not solved" in desk.session.note
    desk.say("discard")
    assert (desk.session.state, desk.session.status()["count"]) == (TeleopState.WAITING, 1)
    assert not desk.recordings()
    desk.say("discard")
    assert (desk.session.status()["count"], desk.session.kept) == (2, 0)


def test_what_is_kept_at_success_is_kept_at_the_end(tmp_path: Path) -> None:
    desk = Desk(tmp_path, episodes=1)
    operator = Operator(desk.session)
    while desk.session.state is not TeleopState.OVER:
        assert desk.session.state is not TeleopState.DECIDE
        data = operator.next_message()
        if desk.session.state is TeleopState.SUCCESS:
            desk.session.receive(b'{"kind": "keep"}', desk.now)
        desk.session.receive(data, desk.now)
        desk.wait()
    (recording,) = desk.recordings()
    assert recording.success_step == len(recording) - CONTROL_HZ
    desk.session.close()


def test_a_button_counts_once_for_each_press(desk: Desk) -> None:
    pressed = {"keep": False, "discard": True, "recentre": False}
    for _ in range(5):
        desk.send(buttons=pressed)
    assert desk.session.status()["count"] == 0  # it was pressed when the session began
    desk.send()
    for _ in range(5):
        desk.send(buttons=pressed)
    assert desk.session.status()["count"] == 1


def test_an_episode_that_takes_too_long_is_no_success_but_may_be_kept(tmp_path: Path) -> None:
    desk = Desk(tmp_path, time_limit_s=0.2, episodes=1)
    desk.begin()
    for _ in range(6):
        desk.send()
    assert (desk.session.state, desk.session.status()["success"]) == (TeleopState.DECIDE, False)
    assert "Time is up" in desk.session.note
    desk.say("keep")
    (recording,) = desk.recordings()
    assert recording.info.outcome is not None
    assert (recording.info.outcome.success, recording.info.outcome.kept) == (False, True)
    desk.session.close()


def test_an_episode_that_nobody_decided_about_says_so(tmp_path: Path) -> None:
    desk = Desk(tmp_path, time_limit_s=0.1)
    desk.begin()
    for _ in range(3):
        desk.send()
    assert desk.session.state is TeleopState.DECIDE
    desk.session.close()
    (recording,) = desk.recordings()
    assert recording.info.outcome is not None
    assert (recording.info.outcome.kept, recording.info.outcome.cut) == (False, False)
    assert "whether to keep" in str(recording.info.outcome.reason)


def test_an_instruction_that_is_typed_is_that_of_the_episode_that_waits(desk: Desk) -> None:
    own = desk.session.status()["instruction"]
    start = desk.session.env.base.backend.read().flat
    desk.say("instruction", text="Lift the pot together.")
    assert desk.session.status()["instruction"] == "Lift the pot together."
    np.testing.assert_array_equal(desk.session.env.base.backend.read().flat, start)
    desk.begin()
    desk.say("instruction", text="")
    assert desk.session.status()["instruction"] == "Lift the pot together."
    desk.session.env.finish()
    desk.session.env.keep()
    (recording,) = desk.recordings()
    assert recording.info.instruction == "Lift the pot together."
    assert recording.info.task_instruction == own
    desk.say("discard")
    assert desk.session.status()["instruction"] == own


def test_in_lockstep_a_message_is_a_step_however_late_it_comes() -> None:
    desk = Desk(None, lockstep=True)
    desk.send()
    desk.turn += 1000
    desk.send(left=1)
    for number in range(5):
        desk.session.receive(message(0, *(hand(HOMES[side]) for side in SIDES)), 0.0)
        assert desk.session.status()["step"] == 1 + number
        desk.wait(2)
    desk.session.close()


def test_hands_are_told_what_they_cannot_see(desk: Desk) -> None:
    desk.begin()
    for number in range(40):
        desk.send(left=1, right=1, shift=UP * number)
    pulses = desk.session.haptics.take()
    assert {(pulse["side"], pulse["strength"]) for pulse in pulses} == {
        ("left", 0.8),
        ("right", 0.8),
    }
    desk.wait(10)
    assert [pulse["strength"] for pulse in desk.session.haptics.take()] == [1.0, 1.0]


def test_what_is_refused_changes_nothing(desk: Desk) -> None:
    desk.begin()
    with pytest.raises(MessageError):
        desk.session.receive(b'{"kind": "fly"}', desk.now)
    desk.send(left=1, right=1)
    assert desk.session.state is TeleopState.RECORDING


def test_a_session_says_what_it_needs() -> None:
    env = make_recorder(TASK, None, PERSON, action_mode="joint")
    with pytest.raises(OptionError, match="'cartesian'"):
        Teleoperation(env, HandDevice())
    with pytest.raises(OptionError, match="at least one episode"):
        Teleoperation(env, HandDevice(), episodes=0)
    env.close()
    with pytest.raises(OptionError, match="at least one control step"):
        make_recorder(TASK, None, PERSON, time_limit_s=0.0)


def test_a_killed_session_leaves_an_episode_that_can_be_recovered(desk: Desk) -> None:
    desk.begin()
    for _ in range(20):
        desk.send(left=1)
    data = desk.session.env.data
    assert data is not None
    (partial,) = data.partials()
    copy = DataSet.open(data.path.parent / "copy").partial(TASK, "x")
    copy.parent.mkdir(parents=True)
    copy.write_bytes(partial.read_bytes())
    recording = Recording.read(DataSet(data.path.parent / "copy").recover(copy))
    assert recording.clutch[1:].tolist() == [[True, False]] * (len(recording) - 1)
    assert recording.clutch[0].tolist() == [True, True]
