"""Recordings that go on after success."""

from pathlib import Path

import numpy as np
import pytest

import duobench
from duobench.core.errors import OptionError
from duobench.data import DataSet, Recorder, Recording
from duobench.envs import ResetNeededError
from duobench.evaluation import find_tasks
from duobench.evaluation.replay import replay
from duobench.evaluation.runners import record
from tests.data.tools import ended
from tests.envs.tools import wave
from tests.evaluation.toy_tasks import HORIZON, NUDGE

STEPS = 10
SECONDS = 0.34
"""Rounded, they are that many control steps."""
Ends = list[tuple[bool, bool, bool]]


def nudging(folder: Path, after_success: float = SECONDS, horizon: int = HORIZON) -> Recorder:
    env = duobench.make(NUDGE, cameras=False, horizon=horizon)
    return Recorder(env, folder, after_success=after_success)


def play(env: Recorder, steps: int = 100) -> Ends:
    """Whether each step succeeded, terminated and truncated, until the episode is over."""
    env.reset(seed=0)
    ends = []
    for number in range(steps):
        *_, terminated, truncated, info = env.step(wave(number))
        ends.append((info["success"], terminated, truncated))
        if terminated or truncated:
            break
    return ends


def last(folder: Path) -> Recording:
    return Recording.read(DataSet.open(folder).episodes()[-1])


@pytest.fixture(scope="module")
def success(tmp_path_factory: pytest.TempPathFactory) -> int:
    """The step at which the task is solved; without the option, the last one."""
    folder = tmp_path_factory.mktemp("plain")
    ends = play(nudging(folder, 0.0))
    assert ends[-1] == (True, True, False)
    rows = last(folder)
    assert (rows.info.after_success, rows.success_step) == (0.0, len(ends))
    return len(ends)


@pytest.mark.parametrize("spare", [100, STEPS, 3, 0])
def test_an_episode_goes_on_after_success_and_beyond_the_horizon(
    tmp_path: Path, success: int, spare: int
) -> None:
    env = nudging(tmp_path, horizon=success + spare)
    ends = play(env)
    assert ends[:success] == [(False, False, False)] * (success - 1) + [(True, False, False)]
    assert ends[success:] == [(True, False, False)] * (STEPS - 1) + [(True, True, False)]
    with pytest.raises(ResetNeededError):
        env.step(wave(0))
    rows = last(tmp_path)
    assert rows.info.after_success == STEPS / 30
    np.testing.assert_array_equal(rows.success, np.arange(success + STEPS + 1) >= success)
    outcome = ended(rows)
    assert (outcome.success, outcome.cut, outcome.success_step) == (True, False, success)
    assert rows.info.last_hash == env.state_hash()
    assert next(replay(NUDGE, [rows])).is_exact
    assert [each[1:] for each in play(env)] == [each[1:] for each in ends], "again after a reset"
    env.close()


def test_arms_that_cannot_go_on_end_it_at_once(tmp_path: Path, success: int) -> None:
    env = nudging(tmp_path)
    play(env, success + 2)
    env.base.backend.hold("Somebody came too near.")
    assert env.step(wave(0))[2:4] == (True, True)
    outcome = ended(last(tmp_path))
    assert (outcome.success, outcome.cut) == (True, False)
    assert outcome.reason == "Somebody came too near."
    env.close()


def test_what_is_cut_after_success_says_so_and_is_recovered(tmp_path: Path, success: int) -> None:
    env = nudging(tmp_path)
    play(env, success + STEPS - 1)
    data = DataSet.open(tmp_path)
    (partial,) = data.partials()
    left = partial.read_bytes()
    env.close()
    closed = last(tmp_path)
    data.episodes()[0].unlink()
    partial.write_bytes(left)
    recovered = Recording.read(data.recover(partial))
    for rows in (closed, recovered):
        outcome = ended(rows)
        assert (outcome.success, outcome.cut, outcome.success_step) == (True, True, success)
        assert success <= len(rows) < success + STEPS
    assert next(replay(NUDGE, [recovered])).is_exact


@pytest.mark.parametrize("seconds", [-0.1, float("nan"), float("inf")])
def test_impossible_times_are_refused(tmp_path: Path, seconds: float) -> None:
    with pytest.raises(OptionError, match="a number of seconds from 0"):
        nudging(tmp_path, seconds)


def test_an_expert_that_lets_go_quickly_leaves_labels_of_it(tmp_path: Path) -> None:
    data = DataSet.open(tmp_path)
    (attempt,) = record("expert:human", find_tasks(["carry_pot"]), data, episodes=1, workers=0)
    (rows,) = data.recordings()
    assert attempt.steps == rows.success_step == len(rows) - 30
    openings = rows.action[:, [7, 15]]
    last_command = np.flatnonzero(np.diff(openings, axis=0).any(axis=1))[-1] + 1
    assert len(openings) - last_command >= 15
