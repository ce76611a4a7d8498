"""A policy on a simulated rig, recorded with an operator who is a script."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import OptionError, PolicyError
from duobench.core.types import Side
from duobench.data import DataSet, Outcome, Recording, find_problems
from duobench.evaluation.policies import PolicySource
from duobench.policy import PolicyMetadata
from duobench.real.duo import FrankaDuo
from duobench.real.sessions.policy_runner import REASONS
from duobench.real.sessions.recording import Playback, RigRecording, find_policy, slowed
from duobench.results.labels import FaultKind
from duobench.world.robot.cameras import POLICY_CAMERAS
from tests.quick_first import quick_first
from tests.real.rigs import new_rig

TASK = "carry_pot"
HORIZON = 24


class Script:
    """An operator who answers in order, and presses keys at control steps of the episodes."""

    def __init__(
        self, answers: str, presses: dict[int, str] | None = None, usual: str = "q"
    ) -> None:
        self.answers, self._usual = list(answers), usual
        self.presses = presses or {}
        self.said: list[str] = []
        self.asked: list[str] = []
        self.call: Callable[[str], None] | None = None

    def say(self, text: str) -> None:
        self.said.append(text)

    def ask(self, text: str, keys: str) -> str:
        self.asked.append(text)
        key = self.answers.pop(0) if self.answers else self._usual
        assert key in keys, f"{key} is no answer to: {text}"
        return key

    def listen(self, call: Callable[[str], None] | None) -> Callable[[str], None] | None:
        before, self.call = self.call, call
        return before


class Sways:
    """A policy that sways, and has its script press the keys of a step before it acts."""

    metadata = PolicyMetadata(name="sways", cameras=("head",), image_size=(32, 48))

    def __init__(self, script: Script, on_step: Callable[[int], None] = lambda _step: None) -> None:
        self._script, self._on_step = script, on_step

    def reset(self, instruction: str, seed: int) -> None:
        assert instruction
        assert seed
        self._steps = 0

    def act(self, observation: Any) -> np.ndarray:
        assert observation["pixels"]["head"].shape == (32, 48, 3)
        for key in self._script.presses.get(self._steps, ""):
            assert self._script.call is not None
            self._script.call(key)
        self._on_step(self._steps)
        self._steps += 1
        return observation["agent_pos"][None] + 0.005 * np.sin(self._steps / 5)


@contextmanager
def session(
    folder: Path,
    script: Script,
    source: PolicySource | None = None,
    on_step: Callable[[FrankaDuo, int], None] = lambda _duo, _step: None,
    **options: Any,
) -> Iterator[RigRecording]:
    duo = new_rig()
    if source is None:
        policy = Sways(script, lambda step: on_step(duo, step))
        source = PolicySource(metadata=policy.metadata, bind=lambda _env: policy)
    options = {"horizon": HORIZON, "episodes": 1, "after_success": 0.2} | options
    data = DataSet.open(folder)
    with closing(RigRecording(duo, TASK, data, source, script, **options)) as made:
        yield made


def outcome_of(recording: Recording) -> Outcome:
    assert recording.info.outcome is not None
    return recording.info.outcome


def fail(duo: FrankaDuo, text: str, kind: FaultKind = FaultKind.CONTACT) -> None:
    duo.arms[Side.LEFT].fail(text, kind)  # type: ignore[attr-defined]


def test_a_policy_that_reads_where_objects_are_is_refused_at_once(tmp_path: Path) -> None:
    metadata, script = PolicyMetadata(name="sees", cameras=(), object_state=True), Script("")
    source = PolicySource(metadata=metadata, bind=lambda _env: Sways(script))
    with (
        pytest.raises(OptionError, match="need a simulation"),
        session(tmp_path, script, source),
    ):
        pass
    assert script.asked == []


def test_an_operator_records_what_a_policy_does(tmp_path: Path) -> None:
    script = Script("hpkhpdhpk", {4: "1", 6: "2", 8: "u", 12: "s"})
    with session(tmp_path, script, episodes=2) as recording:
        assert recording.run() == 2
    assert script.answers == []
    data = DataSet(tmp_path)
    episodes = list(data.recordings())
    assert [path.stem for path in data.episodes()] == ["00000", "00001"]
    for episode in episodes:
        outcome = outcome_of(episode)
        assert (outcome.success, outcome.kept, outcome.success_step) == (True, True, 13)
        assert len(episode) == 13 + 6
        assert episode.stage[[0, 5, 7, 9, 13]].tolist() == [0, 1, 2, 1, outcome.max_stage]
        assert episode.info.rig is not None
        assert episode.info.rig.name == "simulated"
        assert tuple(episode.info.videos) == POLICY_CAMERAS
        assert (np.diff(episode.frame, axis=0) >= 0).all()
        assert episode.frame_age.min() >= 0.0
        assert episode.frame_age.max() <= 0.1
    assert find_problems(data) == []
    assert "mm" in next(text for text in script.asked if "Place" in text)


@pytest.mark.parametrize(("again", "steps"), quick_first([(None, HORIZON), (14, 15 + 6)]))
def test_success_that_was_taken_back_leaves_an_episode_like_others(
    tmp_path: Path, again: int | None, steps: int
) -> None:
    script = Script("hpk", {4: "s", 8: "u"} | ({} if again is None else {again: "s"}))
    with session(tmp_path, script) as recording:
        recording.run()
    (episode,) = DataSet(tmp_path).recordings()
    outcome = outcome_of(episode)
    assert len(episode) == steps
    assert outcome.success is (again is not None)
    assert outcome.success_step == (None if again is None else again + 1)
    assert find_problems(DataSet(tmp_path)) == []


@pytest.mark.slow
def test_the_same_session_records_the_same(tmp_path: Path) -> None:
    found = []
    for name in ("a", "b"):
        with session(tmp_path / name, Script("hpk", {3: "1"})) as recording:
            recording.run()
        (path,) = DataSet(tmp_path / name).episodes()
        found.append(
            [path.read_bytes(), *(v.read_bytes() for v in DataSet(tmp_path / name).videos())]
        )
    assert found[0] == found[1]


@pytest.mark.slow
def test_a_session_goes_on_where_it_ended(tmp_path: Path) -> None:
    with session(tmp_path, Script("hpkq"), episodes=3) as recording:
        assert recording.run() == 1
    with session(tmp_path, Script("hpq"), episodes=3) as recording:
        assert recording.kept == 1
        recording.run()
    first, second = DataSet(tmp_path).recordings()
    assert first.info.seed != second.info.seed
    assert not outcome_of(second).kept  # nobody decided about it


@pytest.mark.parametrize("key", [" ", ""])
def test_a_hold_ends_the_episode_and_keeps_what_was_recorded(tmp_path: Path, key: str) -> None:
    script = Script("hpkhpd")

    def press(_duo: FrankaDuo, step: int) -> None:
        if step == 7:
            assert script.call is not None
            script.call(key)

    with session(tmp_path, script, on_step=press) as recording:
        assert recording.run() == 1
    (episode,) = DataSet(tmp_path).recordings()
    assert "operator" in str(outcome_of(episode).reason)
    assert 7 <= len(episode) <= 9


def test_a_fault_is_in_the_record_and_recovered_by_the_operator(tmp_path: Path) -> None:
    faults = iter([True])

    def touch(duo: FrankaDuo, step: int) -> None:
        if step == 5 and next(faults, False):
            fail(duo, "cartesian_reflex")

    script = Script("hpkrhpk")
    with session(tmp_path, script, on_step=touch, episodes=2) as recording:
        assert recording.run() == 2
    broken, whole = DataSet(tmp_path).recordings()
    assert "cartesian_reflex" in str(outcome_of(broken).reason)
    assert len(broken) in {5, 6, 7}
    assert len(whole) == HORIZON
    assert any("Something is wrong" in text for text in script.asked)
    assert find_problems(DataSet(tmp_path)) == []


def test_an_emergency_stop_is_asked_about_and_nothing_is_kept(tmp_path: Path) -> None:
    def stop(duo: FrankaDuo, step: int) -> None:
        if step == 5:
            fail(duo, "User Stop pressed!", FaultKind.PERSON)

    script = Script("hp2rq")
    with session(tmp_path, script, on_step=stop) as recording:
        assert recording.run() == 0
    assert script.answers == []
    assert "Why did the arms stop?" in script.asked[2]
    assert REASONS[FaultKind.PERSON][1] in script.said
    assert list(DataSet(tmp_path).recordings()) == []


def test_a_policy_that_fails_loses_nothing(tmp_path: Path) -> None:
    def give_up(_duo: FrankaDuo, step: int) -> None:
        if step == 6:
            raise PolicyError("It has no idea.")

    with session(tmp_path, Script("hpkq"), on_step=give_up) as recording:
        assert recording.run() == 0
    (episode,) = DataSet(tmp_path).recordings()
    outcome = outcome_of(episode)
    assert (outcome.kept, outcome.reason, len(episode)) == (False, "It has no idea.", 6)


def test_nothing_moves_without_a_key(tmp_path: Path) -> None:
    for answers in ("q", "hq"):
        with session(tmp_path, Script(answers)) as recording:
            arm: Any = recording.duo.arms[Side.LEFT]
            commands = arm.commands
            recording.run()
            assert not recording.duo.supervisor.is_confirmed
            assert arm.commands == commands or answers == "hq"
    assert DataSet(tmp_path).episodes() == []


@pytest.mark.slow
def test_a_recorded_episode_is_played_at_half_of_its_speed(tmp_path: Path) -> None:
    with session(tmp_path / "first", Script("hpk")) as recording:
        recording.run()
    (path,) = DataSet(tmp_path / "first").episodes()
    before = Recording.read(path)
    source = find_policy(str(path))
    with session(tmp_path / "second", Script("hpk"), source, horizon=2 * HORIZON) as recording:
        recording.run()
    (after,) = DataSet(tmp_path / "second").recordings()
    np.testing.assert_allclose(after.sent[: 2 * HORIZON - 1 : 2], before.sent, atol=1e-6)
    assert after.info.actor.name == "playback of carry_pot/00000 at 0.5 of its speed"
    assert after.info.actor.kind == "program"


def test_slower_commands_begin_and_end_alike() -> None:
    commands = np.linspace(0.0, 1.0, 11)[:, None] * np.ones(16)
    slow = slowed(commands, 0.3)
    assert np.abs(np.diff(slow, axis=0)).max() == pytest.approx(0.03)
    assert (slow[0, 0], slow[-1, 0]) == (0.0, 1.0)
    np.testing.assert_array_equal(slowed(commands, 1.0), commands)


def test_what_cannot_be_played_is_said(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match="reads the simulation"):
        find_policy("expert")
    with session(tmp_path, Script("hpk")) as recording:
        recording.run()
    (episode,) = DataSet(tmp_path).recordings()
    with pytest.raises(OptionError, match="tempo"):
        Playback(episode, tempo=1.5)
