"""A session of teleoperation on a simulated rig, with a peer that is a script."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import MessageError, OptionError
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.data import Actor, ActorKind, DataSet, find_problems
from duobench.data.attempts import of_task
from duobench.real.rig import Rig
from duobench.real.sessions.messages import Home, Stage
from duobench.real.sessions.preparing import PLACED
from duobench.real.sessions.rig_teleoperation import (
    ENDED,
    RigTeleoperation,
    RigTeleopPage,
    make_real_recorder,
)
from duobench.real.sessions.session import CONNECTION_LOST, HELD_BY_OPERATOR, STOPPED
from duobench.real.supervisor import State
from duobench.results.labels import FaultKind
from duobench.teleop.hands import HandDevice
from duobench.teleop.messages import Discard
from duobench.teleop.policy_leader import PolicyLeader
from duobench.teleop.teleop_page import WATCHING
from duobench.teleop.teleoperation import TeleopState
from duobench.web.server import PageServer
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.cameras import POLICY_CAMERAS
from duobench.world.robot.frames import ROBOT
from tests.real.rigs import new_rig, once_while_homing, quick_rig
from tests.teleop.operator import HOMES, hand, message, said
from tests.teleop.toy import POLICY, Toy
from tests.web.pages import open_page, wait_until

TASK = "carry_pot"
PERSON = Actor(kind=ActorKind.PERSON, name="P07", device="headset")


class Keys:
    """A terminal whose keys a script presses."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.call: Callable[[str], object] = lambda _key: None

    def say(self, text: str) -> None:
        self.said.append(text)

    def ask(self, text: str, keys: str) -> str:
        raise AssertionError(f"nothing waits for a key: {text} {keys}")

    def listen(self, call: Any) -> Any:
        before, self.call = self.call, call
        return before

    def press(self, key: str) -> None:
        self.call(key)


class Bench:
    """A session on a rig on a virtual clock, and hands that are sent thirty times a second."""

    def __init__(
        self,
        folder: Path,
        *,
        is_ready: bool = True,
        rig: Rig | None = None,
        task: str = TASK,
        toy: Toy | None = None,
        **options: Any,
    ) -> None:
        self.duo = new_rig(rig)
        self.terminal = Keys()
        seen = None if toy is None else toy.metadata
        recorder = make_real_recorder(
            self.duo, task, folder, PERSON, metadata=seen, after_success=0.2
        )
        if toy is not None:
            toy.hold = recorder.get_wrapper_attr("hold_action")
            options["policy"] = PolicyLeader(recorder, toy, POLICY, waits=True)
        self.session = RigTeleoperation(recorder, HandDevice(), self.terminal, **options)
        self.turn = 0
        self.pressed = ""
        """Keys that made the arms ready since they were asked for."""
        if is_ready:
            self.make_ready()

    def make_ready(self) -> None:
        """Press at the terminal what leads to the next step, until an episode waits."""
        self.pressed = ""
        while self.session.state is TeleopState.MAKING_READY:
            assert len(self.pressed) < 10, self.session.panel
            (key,) = (each.key for each in self.session.panel.buttons if each.is_next)
            self.pressed += key
            self.terminal.press(key)
            self.advance()

    def advance(self) -> None:
        self.session.advance(self.turn / CONTROL_HZ)

    def send(self, squeeze: float = 0.0, height: float = 0.0) -> None:
        now = self.turn / CONTROL_HZ
        hands = [hand(HOMES[side].moved(0.0, 0.0, height), squeeze=squeeze) for side in SIDES]
        self.session.receive(said(message(self.turn, *hands)), now)
        self.session.advance(now)
        self.turn += 1

    def lead(self, steps: int) -> None:
        """Let go, squeeze, and raise both hands by 3 cm."""
        self.send()
        for step in range(steps):
            self.send(1.0, 0.03 * min(1.0, step / 15))

    def say(self, kind: str, *, is_ready: bool = True) -> None:
        """Say something at the page; then make the arms ready, if that is due."""
        self.session.receive(said(f'{{"kind": "{kind}"}}'), self.turn / CONTROL_HZ)
        self.advance()
        if is_ready:
            self.make_ready()


def test_hands_lead_real_arms_and_who_leads_says_that_it_is_solved(tmp_path: Path) -> None:
    bench = Bench(tmp_path, episodes=1)
    before = Kinematics(ROBOT).forward(bench.duo.last_command.joints)
    bench.lead(30)
    bench.say("keep")  # while it runs: it is solved
    for _ in range(10):
        bench.send(1.0, 0.03)
    assert bench.session.state is TeleopState.OVER
    after = Kinematics(ROBOT).forward(bench.duo.last_command.joints)
    for side in SIDES:
        moved = after[side].translation - before[side].translation
        assert moved == pytest.approx([0.0, 0.0, 0.03], abs=1e-3)
    bench.session.close()
    (episode,) = DataSet(tmp_path).recordings()
    outcome = episode.info.outcome
    assert outcome is not None
    assert (outcome.success, outcome.kept) == (True, True)
    assert episode.clutch.any(axis=1).mean() > 0.9
    assert tuple(episode.info.videos) == POLICY_CAMERAS
    assert episode.info.layout["poses"]
    assert episode.info.split == "train"
    assert find_problems(DataSet(tmp_path)) == []


def test_a_policy_plays_on_real_arms_until_a_squeeze(tmp_path: Path) -> None:
    toy = Toy(cameras=("head",), image_size=(32, 32))
    bench = Bench(tmp_path, episodes=1, toy=toy)
    bench.send()
    bench.send(1.0)  # begins
    for _ in range(6):
        bench.send()
    for step in range(20):
        bench.send(1.0, 0.03 * min(1.0, step / 15))
    for _ in range(3):
        bench.send(0.0, 0.03)
    bench.say("keep")
    while bench.session.state is not TeleopState.OVER:
        bench.send(0.0, 0.03)
    bench.session.close()
    (episode,) = DataSet(tmp_path).recordings()
    assert episode.leader[:30].tolist() == [0] * 7 + [1] * 20 + [0] * 3
    assert [each.name for each in episode.info.leaders] == ["toy", "P07"]
    assert [each.step for each in episode.info.takeovers] == [7]
    assert all(shown["pixels"]["head"].shape == (32, 32, 3) for shown in toy.shown)
    jumps = np.abs(np.diff(episode.sent, axis=0)).max(axis=1)
    assert jumps[[6, 26]].max() < 1e-3
    rose = episode.tcp_pose[26, 2] - episode.tcp_pose[6, 2]
    assert rose == pytest.approx(0.03, abs=2e-3)
    assert find_problems(DataSet(tmp_path)) == []


@pytest.mark.slow
def test_arms_hold_unrecorded_while_nobody_leads_and_go_on_at_once(tmp_path: Path) -> None:
    bench = Bench(tmp_path, episodes=1)
    clock = bench.duo.clock
    bench.lead(20)
    for _ in range(93):  # as long as something may still move
        bench.send()
    session, step = bench.session, bench.session.status()["step"]
    there, began = bench.duo.read().joints, clock.now()
    while clock.now() < began + 40.0:  # longer than arms hold that are told nothing
        bench.send()
    assert (session.state, session.status()["pace"]) == (TeleopState.RECORDING, "standing")
    assert (session.status()["step"], bench.duo.held) == (step, None)
    assert bench.duo.supervisor.state is State.RUNNING
    assert np.abs(bench.duo.read().joints - there).max() < 1e-3
    for _ in range(10):
        bench.send(1.0)
    assert session.status()["step"] == step + 10
    bench.say("keep")
    for _ in range(10):
        bench.send(1.0)
    session.close()
    (episode,) = DataSet(tmp_path).recordings()
    periods = np.diff(episode.time)
    assert np.flatnonzero(periods > 0.05).tolist() == [step - 1]
    assert periods.max() > 40.0
    for video in episode.info.videos.values():
        assert video.frames is not None
        assert len(episode) <= video.frames < len(episode) + 10
    assert find_problems(DataSet(tmp_path)) == []


def test_what_is_solved_while_nobody_leads_comes_to_its_end(tmp_path: Path) -> None:
    bench = Bench(tmp_path, episodes=1)
    bench.lead(5)
    for _ in range(100):
        bench.send()
    assert bench.session.status()["pace"] == "standing"
    bench.say("keep")
    for _ in range(10):
        bench.send()
    assert bench.session.state is TeleopState.OVER
    bench.session.close()
    (episode,) = DataSet(tmp_path).recordings()
    assert episode.info.outcome is not None
    assert episode.info.outcome.success


@pytest.mark.slow
def test_arms_that_are_held_while_nobody_leads_end_the_episode(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.lead(5)
    for _ in range(100):
        bench.send()
    assert bench.session.status()["pace"] == "standing"
    bench.duo.hold(HELD_BY_OPERATOR)
    bench.send()
    assert bench.session.state is TeleopState.DECIDE
    assert HELD_BY_OPERATOR in bench.session.note
    bench.session.close()


@pytest.mark.slow
def test_rows_begin_when_the_operator_does(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    clock = bench.duo.clock
    clock.wait_until(clock.now() + 20.0)  # objects are placed
    bench.lead(10)
    bench.say("discard")
    bench.lead(10)
    bench.session.close()
    (episode,) = DataSet(tmp_path).recordings()
    assert np.diff(episode.time) == pytest.approx(1 / CONTROL_HZ, abs=1e-6)
    assert episode.info.outcome is not None
    assert not episode.info.outcome.kept


def test_a_discarded_episode_comes_back_with_its_videos(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.lead(10)
    bench.say("discard")
    data = DataSet(tmp_path)
    assert data.episodes() == []
    assert len(data.discarded.videos()) == len(POLICY_CAMERAS)
    bench.lead(5)
    bench.say("restore")
    assert bench.session.state is TeleopState.RECORDING
    bench.say("discard")
    assert bench.session.state is TeleopState.DECIDE, "asked before the arms go home"
    bench.say("keep")
    (path,) = data.episodes()
    assert {video.name for video in data.videos()} >= {
        f"{path.stem}.{camera}.mp4" for camera in POLICY_CAMERAS
    }
    bench.session.close()
    assert find_problems(data) == []
    assert not data.discarded.path.exists()


def test_nothing_moves_without_the_operators_word(tmp_path: Path) -> None:
    bench = Bench(tmp_path, is_ready=False)
    for _ in range(3):
        bench.send(1.0)
    assert bench.duo.supervisor.state is State.CONNECTED
    bench.terminal.press("q")
    bench.advance()
    assert (bench.session.state, bench.session.note) == (TeleopState.OVER, ENDED)
    bench.session.close()
    assert DataSet(tmp_path).episodes() == []


def test_hands_lead_nothing_before_the_objects_are_placed(tmp_path: Path) -> None:
    bench = Bench(tmp_path, is_ready=False)
    bench.terminal.press("h")
    bench.lead(5)
    assert bench.duo.supervisor.state is State.READY
    assert not bench.duo.supervisor.is_confirmed, "people's hands are among the objects"
    assert bench.session.panel.title == PLACED
    bench.terminal.press("p")
    bench.advance()
    bench.lead(5)
    assert bench.session.state is TeleopState.RECORDING
    bench.session.close()


def test_after_a_fault_the_operator_recovers(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.lead(10)
    bench.duo.arms[Side.RIGHT].fail("joint_reflex", FaultKind.CONTACT)  # type: ignore[attr-defined]
    bench.send(1.0)
    assert bench.session.state is TeleopState.DECIDE
    assert "joint_reflex" in bench.session.note
    bench.say("keep")
    assert bench.pressed == "rhp"
    assert "joint_reflex" in "".join(bench.terminal.said)
    bench.lead(5)
    bench.say("discard")
    bench.session.close()
    (episode,) = DataSet(tmp_path).recordings()
    assert episode.info.outcome is not None
    assert "joint_reflex" in str(episode.info.outcome.reason)


def test_arms_that_do_not_get_home_are_asked_about_again(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.lead(10)
    once_while_homing(bench.duo, lambda: bench.duo.hold(CONNECTION_LOST))
    bench.say("discard")
    assert (bench.session.state, bench.pressed) == (TeleopState.WAITING, "hhp")
    assert CONNECTION_LOST in "".join(bench.terminal.said)
    (attempt,) = of_task(DataSet(tmp_path), TASK)
    assert attempt.episode == 0, "the way home is no attempt"
    bench.say("restore")  # what was discarded before is still there
    bench.say("keep")
    assert len(DataSet(tmp_path).episodes()) == 1
    bench.session.close()


def test_arms_that_are_held_before_an_episode_begins_go_home_again(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.send()
    bench.duo.hold(CONNECTION_LOST)
    bench.lead(5)
    assert bench.session.state is TeleopState.MAKING_READY
    assert CONNECTION_LOST in bench.session.panel.todo
    bench.make_ready()
    bench.lead(5)
    assert (bench.duo.held, bench.session.status()["count"]) == (None, 0)
    assert bench.session.status()["step"] > 1
    bench.session.close()


@pytest.mark.parametrize("is_lost", [True, False])
def test_solved_is_kept_where_the_session_ends_before_the_recording(
    tmp_path: Path, is_lost: bool
) -> None:
    bench = Bench(tmp_path, episodes=2)
    bench.lead(5)
    bench.say("keep")
    bench.send(1.0)
    if is_lost:
        bench.duo.hold(CONNECTION_LOST)
        bench.session.leave(bench.turn / CONTROL_HZ)
        bench.advance()
        assert bench.session.state is TeleopState.MAKING_READY
    else:
        bench.session.stop()
    bench.session.close()
    (episode,) = DataSet(tmp_path).recordings()
    outcome = episode.info.outcome
    assert outcome is not None
    assert (outcome.success, outcome.kept, bench.session.kept) == (True, True, 1)
    assert find_problems(DataSet(tmp_path)) == []
    (attempt,) = of_task(DataSet(tmp_path), TASK)
    assert (attempt.success, attempt.kept) == (True, True)


@pytest.mark.slow
def test_solved_is_taken_back(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.lead(5)
    bench.say("keep")
    bench.send(1.0)
    assert bench.session.state is TeleopState.SUCCESS
    bench.terminal.press("u")
    for _ in range(15):
        bench.send(1.0, 0.03)
    assert bench.session.state is TeleopState.RECORDING
    bench.duo.hold(HELD_BY_OPERATOR)
    bench.send(1.0)
    assert bench.session.state is TeleopState.DECIDE  # it was to be kept because it was solved
    bench.say("discard")
    bench.session.close()
    assert DataSet(tmp_path).episodes() == []


@pytest.mark.slow
def test_stages_are_pressed_while_arms_are_led(tmp_path: Path) -> None:
    """At the terminal and at the page; corrected before the episode is kept."""
    bench = Bench(tmp_path)
    bench.lead(5)
    bench.terminal.press("1")
    bench.send(1.0, 0.03)
    bench.session.receive(Stage(stage=3), 0.0)  # by mistake
    bench.send(1.0, 0.03)
    assert bench.session.state is TeleopState.SUCCESS
    bench.terminal.press("u")
    bench.send(1.0, 0.03)
    assert bench.session.state is TeleopState.RECORDING
    assert [each.stage for each in bench.session.status()["presses"]] == [1, 3, None]
    with pytest.raises(OptionError):
        bench.session.receive(Stage(stage=9), 0.0)
    bench.duo.hold(HELD_BY_OPERATOR)
    bench.send(1.0)
    assert bench.session.state is TeleopState.DECIDE
    bench.terminal.press("2")
    bench.say("keep")
    with pytest.raises(MessageError, match="Not now"):
        bench.session.receive(Stage(stage=1), 0.0)
    bench.session.close()
    (episode,) = DataSet(tmp_path).recordings()
    outcome = episode.info.outcome
    assert outcome is not None
    assert (outcome.stage, outcome.success) == (2, False)
    assert sorted(set(episode.stage.tolist())) == [0, 1, 2]


@pytest.mark.slow
def test_page_leads_from_grippers_that_are_off_to_a_kept_episode(tmp_path: Path) -> None:
    """Nobody touches the terminal; who watches may hold."""
    bench = Bench(tmp_path, rig=quick_rig(cameras=True), task="bin_sort", is_ready=False)
    with closing(PageServer({})) as server:
        live = RigTeleopPage(bench.session, server, silence_s=600.0)
        with open_page(server.url) as page, open_page(server.url) as other:
            page.drive()

            def press(words: str) -> None:
                """Press the button that is the next step, once it is there."""
                for _ in range(200):
                    bench.advance()
                    live.show()
                    panel = page.hear_of("status")["panel"]
                    found = [each for each in panel["buttons"] if each["is_next"]]
                    if found and found[0]["id"] == words:
                        page.say(**found[0]["message"])
                        wait_until(lambda: bench.session._inbox._waiting)
                        bench.advance()
                        return
                raise AssertionError(panel)

            press("activate")
            press("home")
            press("placed")
            bench.advance()
            assert bench.session.state is TeleopState.WAITING
            other.say(kind="hold")
            wait_until(lambda: bench.duo.held == HELD_BY_OPERATOR)
            bench.advance()
            press("home")
            press("placed")
            bench.lead(5)
            assert bench.session.state is TeleopState.RECORDING
            page.say(kind="stage", stage=2)
            wait_until(lambda: bench.session.status()["presses"])
            other.say(kind="stage", stage=1)
            other.hear_of("refused", reason=WATCHING)
            page.say(kind="keep")
            wait_until(lambda: bench.session._inbox._waiting)
            for _ in range(12):
                bench.send(1.0, 0.03)
    assert bench.session.kept == 1
    assert bench.session.state is TeleopState.MAKING_READY
    bench.session.close()
    (episode,) = DataSet(tmp_path).recordings()
    assert episode.info.outcome is not None
    assert (episode.info.outcome.success, episode.info.outcome.kept) == (True, True)
    assert find_problems(DataSet(tmp_path)) == []


def test_page_without_a_sign_holds_the_arms_that_it_sent_home(tmp_path: Path) -> None:
    bench = Bench(tmp_path, is_ready=False)
    with closing(PageServer({})) as server:
        RigTeleopPage(bench.session, server, silence_s=0.0)
        with open_page(server.url) as page:
            page.drive()
            page.say(kind="home")
            wait_until(lambda: bench.session._inbox._waiting)
            bench.advance()
    assert bench.session.state is TeleopState.MAKING_READY
    assert "gave no sign" in bench.session.panel.todo
    assert list(of_task(DataSet(tmp_path), TASK)) == []
    bench.session.close()


def test_second_press_skips_nothing(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.lead(5)
    bench.session.receive(Discard(), 0.0)
    bench.say("discard")
    bench.send()
    assert (bench.session.state, bench.session.status()["count"]) == (TeleopState.WAITING, 1)
    bench.session.close()


def test_hold_after_the_press_of_home_moves_nothing(tmp_path: Path) -> None:
    bench = Bench(tmp_path, is_ready=False)
    bench.session.receive(Home(), 0.0)
    bench.terminal.press(" ")
    bench.advance()
    assert bench.duo.supervisor.state is State.HOLDING
    bench.make_ready()
    assert bench.pressed == "hp"
    bench.session.close()


def test_stop_holds_arms_that_go_home_and_ends_the_session(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.lead(10)
    bench.say("discard", is_ready=False)
    once_while_homing(bench.duo, bench.session.stop)
    bench.terminal.press("h")
    bench.advance()
    assert bench.duo.held == STOPPED
    bench.session.close()


@pytest.mark.slow
def test_session_that_ends_between_episodes_notes_none(tmp_path: Path) -> None:
    bench = Bench(tmp_path, episodes=3)
    bench.lead(10)
    bench.say("keep")
    for _ in range(10):
        bench.send(1.0)
    bench.terminal.press("q")
    bench.advance()
    assert bench.session.state is TeleopState.OVER
    bench.session.close()
    (attempt,) = of_task(DataSet(tmp_path), TASK)
    assert (attempt.episode, attempt.success, attempt.kept) == (0, True, True)


def test_space_bar_still_holds_after_a_recovery(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.lead(10)
    bench.duo.arms[Side.RIGHT].fail("joint_reflex", FaultKind.CONTACT)  # type: ignore[attr-defined]
    bench.send(1.0)
    bench.say("discard")
    bench.lead(5)
    bench.terminal.press(" ")
    assert bench.duo.held == HELD_BY_OPERATOR
    bench.session.close()


def test_the_page_shows_the_arms_and_holds_them_when_it_is_lost(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    with closing(PageServer({})) as server:
        live = RigTeleopPage(bench.session, server)
        with open_page(server.url) as page:
            page.drive()
            live.show()
            first = page.frame()
            for _ in range(3):
                bench.lead(10)
                live.show()
            page.hear_of("status", state="recording")
            while page.frame()[16:] == first[16:]:  # the arms have moved in the newest one
                pass
        wait_until(lambda: not server.has_viewers)
    bench.send(1.0)
    assert bench.session.state is TeleopState.DECIDE
    assert "connection" in bench.session.note
    bench.session.close()
