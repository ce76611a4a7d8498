"""A policy that plays in a session, and hands that take over from it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import duobench
from dev.benchmarks.corrections import (
    FROZEN,
    LAYOUTS,
    LIMIT,
    POLICIES,
    TASKS,
    measure,
    record,
)
from dev.tools.corrector import LATE_S, LOST_S, Fails
from dev.tools.entries import entry
from duobench.core.errors import LeaderError, MachineryError, PolicyError
from duobench.core.randomness import TRAIN, episode_seed
from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, DuoCommand
from duobench.data import Actor, ActorKind, DataSet, Recording, find_problems, transitions
from duobench.data.used_rows import RowChoice, used_rows
from duobench.envs.action_modes import ACTION_MODES
from duobench.tasks.experts.motion import Arms
from duobench.teleop.hands import HandDevice, TriggeredGripper
from duobench.teleop.leaders.device import LeaderDevice
from duobench.teleop.leaders.lerobot_source import LeRobotSource
from duobench.teleop.messages import Alone, Discard, Why
from duobench.teleop.policy_leader import LOST, PolicyLeader
from duobench.teleop.teleoperation import Teleoperation, make_recorder
from duobench.world.objects.joint_blocks import BAR
from tests.teleop.leaders.test_device import Leaders
from tests.teleop.operator import HOMES, hand, message, said
from tests.teleop.toy import POLICY, Toy

TASK = "carry_pot"
PERSON = Actor(kind=ActorKind.PERSON, name="P07", device="headset")


class Room:
    """A session with a toy policy and one left hand; turns pass as they are asked for."""

    def __init__(self, folder: Path, toy: Toy, *, waits: bool = True) -> None:
        env = make_recorder(TASK, folder, PERSON, metadata=toy.metadata, look="default")
        toy.hold = env.get_wrapper_attr("hold_action")
        self.toy, self.env, self.turn = toy, env, 0
        leader = PolicyLeader(env, toy, POLICY, waits=waits)
        self.session = Teleoperation(env, HandDevice(), policy=leader)
        self.send(0.0)
        self.send(1.0)  # begins, and takes over nothing

    def send(self, squeeze: float, *, up: float = 0.0, turns: int = 1, **more: Any) -> bool:
        """In each of some turns the hand, so far squeezed; whether the last one was a step."""
        has_stepped = False
        for _ in range(turns):
            left = hand(HOMES_LEFT.moved(z=up), squeeze=squeeze, **more)
            self.session.receive(said(message(self.turn, left, None)), self.now)
            has_stepped = self.session.advance(self.now)
            self.turn += 1
        return has_stepped

    @property
    def now(self) -> float:
        return self.turn / CONTROL_HZ

    @property
    def sent(self) -> Any:
        return self.env.base.backend.last_command.flat

    def tell(self, what: Any) -> None:
        self.session.receive(what, self.now)

    def close(self) -> Recording:
        self.session.close()
        (path,) = self.env.data.episodes()  # type: ignore[union-attr]
        return Recording.read(path)


HOMES_LEFT = next(iter(HOMES.values()))


@pytest.fixture
def enter(tmp_path: Path) -> Iterator[Callable[..., Room]]:
    """Makes a room, which is closed at the end."""
    rooms = []

    def make(toy: Toy, **options: Any) -> Room:
        rooms.append(Room(tmp_path / "data", toy, **options))
        return rooms[-1]

    yield make
    for room in rooms:
        room.session.close()


@pytest.fixture
def room(enter: Callable[..., Room]) -> Room:
    return enter(Toy())


def test_a_squeeze_takes_over_and_its_release_gives_back(room: Room) -> None:
    room.send(0.0, turns=6)
    asked = len(room.toy.shown)
    room.send(1.0, turns=3)
    room.tell(Why())
    room.tell(Why())
    room.send(1.0)
    assert len(room.toy.shown) == asked  # it is not asked while a person leads
    room.send(0.0, turns=2)
    assert len(room.toy.shown) == asked + 1  # its chunk was thrown away
    rows = room.close()
    assert rows.leader.tolist() == [0] * 7 + [1] * 4 + [0] * 2
    assert rows.info.leaders[0] == POLICY
    assert (rows.info.leaders[1].name, rows.info.leaders[1].kind) == ("P07", ActorKind.PERSON)
    assert [(each.step, each.why) for each in rows.info.takeovers] == [(7, "stuck")]
    assert rows.clutch[:, 0].tolist() == [False] * 7 + [True] * 4 + [False] * 2


@pytest.mark.parametrize("mode", ACTION_MODES)
def test_hands_lead_alike_in_every_action_mode_and_nothing_jumps(enter: Any, mode: str) -> None:
    room = enter(Toy(mode))
    room.send(0.0, turns=3)
    before = room.sent
    room.send(1.0)
    assert np.abs(room.sent - before).max() < 1e-4
    start = room.env.base.backend.read().tcp_poses[0]
    for step in range(40):
        room.send(1.0, up=min(0.1, 0.005 * step))
    rose = room.env.base.backend.read().tcp_poses[0] - start
    np.testing.assert_allclose(rose[:3], [0.0, 0.0, 0.1], atol=0.005)
    rows = room.close()
    assert rows.info.action_mode == mode
    joints = np.delete(np.diff(rows.sent, axis=0), (7, 15), axis=1)
    assert (np.abs(joints) <= LIMIT + 1e-9).all()


def test_a_policy_that_thinks_lets_the_world_wait_and_a_late_answer_is_none(enter: Any) -> None:
    toy = Toy()
    toy.gate = threading.Semaphore(0)
    room = enter(toy, waits=False)
    for _ in range(3):
        assert not room.send(0.0)  # the page goes on
    state = room.env.base.backend.read().flat
    assert room.send(1.0)
    toy.gate.release(1)  # the answer to what was asked before
    assert not room.send(0.0)
    assert np.abs(room.env.base.backend.read().flat - state).max() < 1e-3
    toy.gate.release(1)
    while not room.send(0.0):
        pass
    assert room.close().leader.tolist() == [0, 1]


def test_a_paused_policy_stands_and_hands_stay_in_charge(room: Room) -> None:
    room.send(0.0)
    room.tell(Alone())
    assert not room.send(0.0, turns=3)
    room.send(1.0, turns=2)
    room.send(0.0, turns=2)
    assert not room.session.leading.is_policy
    room.tell(Alone())
    room.send(0.0)
    rows = room.close()
    assert rows.leader.tolist() == [0, 0, 1, 1, 1, 1, 0]
    assert len(rows.info.takeovers) == 1


@pytest.mark.parametrize("seconds", [0.0, 0.6])
def test_a_hand_that_is_lost_gives_nothing_back(room: Room, seconds: float) -> None:
    """It is out of view, or nothing was heard of it for a moment."""
    room.send(0.0)
    room.send(1.0)
    room.turn += round(seconds * CONTROL_HZ)
    room.send(1.0, sure=seconds > 0.0)
    assert room.session.leading.is_paused
    assert room.session.status()["note"] == LOST
    room.send(0.0, turns=2)
    assert not room.session.leading.is_policy


@pytest.mark.parametrize(
    "error",
    [PolicyError("out of ideas"), ValueError("out of ideas"), MachineryError("out of ideas")],
    ids=type,
)
def test_a_policy_that_fails_is_paused_and_may_go_on(room: Room, error: Exception) -> None:
    room.toy.fails = error
    room.send(0.0, turns=8)
    assert "out of ideas" in room.session.status()["note"]
    assert room.send(1.0)
    room.send(0.0)
    room.toy.fails = None
    room.tell(Alone())
    assert room.send(0.0)
    assert room.session.leading.is_policy
    assert room.toy.begun == 2, "a server that was started again has to begin"
    room.toy.fails = error
    room.send(0.0, turns=8)
    room.tell(Discard())
    room.send(0.0)
    assert not room.session.leading.is_paused, "of another episode"


def test_a_policy_that_fails_at_once_says_so_and_begins_anew(enter: Any) -> None:
    toy = Toy("cartesian")
    toy.fails_to_begin = True
    room = enter(toy)
    assert "paused: ValueError: not yet" in room.session.status()["note"]
    toy.fails_to_begin = False
    hold, toy.hold = toy.hold, lambda: np.zeros(16)
    room.tell(Alone())
    assert not room.send(0.0)
    assert "no orientation" in room.session.status()["note"]
    toy.hold = hold
    room.tell(Alone())
    assert room.send(0.0)
    assert room.close().is_led_by_policy.all()


def test_cameras_are_rendered_when_the_policy_is_asked(enter: Any) -> None:
    room = enter(Toy(cameras=("head",), image_size=(32, 32)))
    room.send(0.0, turns=4)
    room.send(1.0, turns=2)
    room.send(0.0)
    backend = room.env.base.backend
    assert len(room.toy.shown) == 3
    for shown in room.toy.shown:
        assert shown["pixels"]["head"].shape == (32, 32, 3)
    assert "pixels" not in room.env.step(room.toy.hold())[0]
    backend.command(DuoCommand.from_flat(room.sent))


def test_a_trigger_is_followed_from_where_it_says_what_the_gripper_does() -> None:
    gripper = TriggeredGripper(0.0, meets=True)
    for trigger in (0.0, 0.5, 0.8):
        gripper.follow(trigger)
        assert gripper.opening == 0.0  # what it holds does not fall
    gripper.follow(0.97)
    gripper.follow(0.4)
    assert gripper.opening == pytest.approx(0.6)


def test_leader_arms_cannot_correct(tmp_path: Path) -> None:
    toy = Toy()
    env = make_recorder(TASK, tmp_path / "data", PERSON, metadata=toy.metadata)
    leader = PolicyLeader(env, toy, POLICY)
    with pytest.raises(LeaderError, match="cannot be let go of"):
        Teleoperation(env, LeaderDevice(LeRobotSource(Leaders())), policy=leader)
    env.close()


# --- a scripted person, through the door of people ---------------------------------------------


@pytest.fixture(scope="module")
def corrected(tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    data = DataSet.open(tmp_path_factory.mktemp("corrected") / "data")
    record(TASK, FROZEN, data, 1)
    return data


@pytest.mark.slow
def test_a_scripted_person_puts_right_what_a_frozen_policy_left(corrected: DataSet) -> None:
    (rows,) = corrected.recordings()
    assert rows.info.seed == episode_seed(TASK, LAYOUTS[0], TRAIN)
    found = measure(corrected, TASK)
    assert (found.episodes, found.failures, found.alone) == (1, 0, 0)
    assert (found.takeovers, found.releases) == (2, 1)
    assert found.largest <= 1.0
    assert found.asked <= 1.0
    assert not find_problems(corrected)


@pytest.mark.slow
def test_corrections_are_used_alone_each_stretch_by_itself(corrected: DataSet) -> None:
    (rows,) = corrected.recordings()
    person = np.flatnonzero(~rows.is_led_by_policy)
    first, second = (each.step for each in rows.info.takeovers)
    choice = RowChoice(only_corrections=True)
    parts = used_rows(rows, choice, TASK).stretches()
    assert [part.steps().rows[0] for part in parts] == [first, second]
    used = np.concatenate([part.steps().rows for part in parts])
    assert set(used) <= set(person)
    before = used_rows(rows, RowChoice(only_corrections=True, from_takeover=2), TASK)
    assert [part.steps().rows[0] for part in before.stretches()] == [first - 2, second - 2]
    (rest,) = used_rows(rows, RowChoice(from_takeover=2, keep_idle=True), TASK).stretches()
    assert rest.spans == ((first - 2, len(rows)),)
    ends = [each.terminated[-1] for each in transitions(corrected, TASK, choice=choice)]
    assert ends == [False, True]


@pytest.mark.long
@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("policy", POLICIES)
def test_most_corrected_episodes_succeed_and_nothing_jumps(
    tmp_path: Path, task: str, policy: str
) -> None:
    data = DataSet.open(tmp_path / "data")
    record(task, policy, data, 20)
    found = measure(data, task)
    assert found.episodes == 20
    assert found.failures <= 13
    assert found.takeovers >= 20
    assert found.largest <= 1.0 + 1e-9
    assert found.asked <= 1.0


@pytest.mark.long
def test_any_policy_is_watched_and_only_what_a_person_led_to_success_is_kept(
    tmp_path: Path,
) -> None:
    data = DataSet.open(tmp_path / "data")
    record("join_blocks", "tests.teleop.toy:Still", data, 1)
    (rows,) = data.recordings()
    ((begin, end, why),) = rows.corrections
    assert (begin, end, why) == (LATE_S * CONTROL_HZ, len(rows), "stuck")
    assert rows.success[-1]
    assert (measure(data, "join_blocks").episodes, len(data.episodes())) == (1, 1)


class Told:
    """A session of which only what the page tells is there, and commands that always move."""

    def __init__(self) -> None:
        self.step = self.stage = 0

    @property
    def env(self) -> Any:
        last = SimpleNamespace(flat=np.array([self.step]))
        return SimpleNamespace(base=SimpleNamespace(backend=SimpleNamespace(last_command=last)))

    def status(self) -> dict[str, Any]:
        return {"stage": self.stage, "step": self.step, "success": self.stage == 3}


@pytest.mark.parametrize(
    ("stages", "step", "why"),
    [
        ({}, LATE_S, "stuck"),
        ({5: 1}, 5 + LATE_S, "stuck"),
        ({2: 1, 4: 0, 4.4: 1}, 2 + LATE_S, "stuck"),
        ({2: 2, 4: 1}, 4 + LOST_S, "dropped"),
        ({2: 3}, None, None),
    ],
)
def test_a_person_sees_that_a_policy_has_failed(
    stages: dict[float, int], step: float | None, why: str | None
) -> None:
    told, sees = Told(), Fails()
    seen = []
    changes = {round(CONTROL_HZ * at): stage for at, stage in stages.items()}
    for told.step in range(round(12 * CONTROL_HZ)):
        told.stage = changes.get(told.step, told.stage)
        seen.append(sees(told))  # type: ignore[arg-type]
    first = next((n for n, reason in enumerate(seen) if reason), None)
    assert (seen[first] if first else None) == why
    assert first == step or abs(first - step * CONTROL_HZ) <= 1


@pytest.mark.slow
def test_bars_are_joined_from_wherever_they_lie() -> None:
    env = duobench.make("join_blocks", cameras=False, action_mode="joint", horizon=900)
    sim = env.get_wrapper_attr("simulation")
    _, info = env.reset(seed=3)
    on_its_side = SE3.at(0.5, -0.2, BAR[1] / 2, yaw=np.pi - 0.3) @ SE3.about((1, 0, 0), np.pi / 2)
    sim.place("light_block", SE3.at(0.45, 0.15, BAR[2] / 2, yaw=-0.9))
    sim.place("dark_block", on_its_side)
    arms = Arms(sim)
    for _ in entry("join_blocks")(arms, info["stage"]):
        info = env.step(arms.action())[-1]
        if info["success"]:
            return
    pytest.fail("the bars are not on the wall")
