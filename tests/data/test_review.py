"""Episodes that wait for a decision, and rows that say which hands led."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import duobench
from duobench.data import Actor, DataSet, Recorder, Recording, stream
from duobench.data.recorder import UNDECIDED
from duobench.errors import DataError
from tests.data.tools import HORIZON, TASK, ended, only, play


def reviewed(folder: Path | None) -> Recorder:
    env = duobench.make(TASK, cameras=False, horizon=HORIZON)
    return Recorder(env, folder, Actor(), is_reviewed=True, has_clutch=True)


def test_a_finished_episode_waits_until_somebody_decides(tmp_path: Path) -> None:
    env, data = reviewed(tmp_path), DataSet.open(tmp_path)
    play(env)
    assert env.pending is not None
    assert not data.episodes()
    (partial,) = data.partials()
    assert len(stream.recover(partial)) == HORIZON  # a kill loses nothing now
    env.keep()
    assert env.pending is None
    play(env, seed=1)
    env.discard()
    env.keep()
    recording = only(tmp_path)
    assert (ended(recording).kept, recording.info.seed) == (True, 0)
    assert recording.info.last_hash is not None
    assert not data.partials()
    env.close()


@pytest.mark.parametrize("steps", [HORIZON, 5])
def test_an_episode_that_is_left_undecided_says_so(tmp_path: Path, steps: int) -> None:
    env = reviewed(tmp_path)
    play(env, steps)
    env.reset(seed=1)
    env.discard()
    env.close()
    recording = only(tmp_path)
    outcome = ended(recording)
    assert (outcome.kept, outcome.cut, outcome.reason) == (False, steps < HORIZON, UNDECIDED)
    assert len(recording) == steps


def test_without_a_data_set_an_episode_waits_in_memory() -> None:
    env = reviewed(None)
    play(env)
    assert env.content is None
    env.keep()
    assert env.content is not None
    assert not Recording.info_of(env.content).is_real
    env.close()


def test_rows_say_which_hands_led(tmp_path: Path) -> None:
    env = reviewed(tmp_path)
    observation, _ = env.reset(seed=0)
    states = [(False, False), (True, False), (True, True), (False, True)]
    for state in states:
        env.clutch = state
        env.step(observation["agent_pos"])
    env.finish()
    env.keep()
    env.close()
    recording = only(tmp_path)
    assert recording.clutch.tolist() == [list(state) for state in states]
    assert recording.info.has_clutch
    assert recording.clutch.dtype == np.bool_


def test_episodes_without_a_clutch_have_no_such_column(tmp_path: Path) -> None:
    env = Recorder(duobench.make(TASK, cameras=False, horizon=5), tmp_path)
    play(env, 5)
    env.close()
    recording = only(tmp_path)
    assert recording.clutch.shape == (5, 0)
    with pytest.raises(DataError, match="'clutch' has shape"):
        replace(recording, clutch=np.ones((5, 2), dtype=bool))
