"""What a recording says about its actions, also in a mode that is added to the table."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pyarrow.parquet as pq
import pytest

import duobench
from duobench.data import (
    ActionSource,
    DataSet,
    ExportOptions,
    Recorder,
    export_lerobot,
    find_problems,
)
from duobench.envs import action_modes
from duobench.errors import DataError, UnknownNameError
from duobench.policy.serving.message_format import ActionFormat, MessageFormat
from duobench.policy.serving.vla_eval import action_spec
from tests.data.degrees import DEGREES, FACTORS
from tests.data.tools import HORIZON, TASK, recorded, recorder
from tests.envs.tools import wave


@pytest.fixture
def degrees(monkeypatch: pytest.MonkeyPatch) -> str:
    """The mode of degrees, in the table for as long as a test runs."""
    table = {**action_modes.ACTION_MODES, DEGREES.name: DEGREES}
    monkeypatch.setattr(action_modes, "ACTION_MODES", table)
    return DEGREES.name


def test_a_further_mode_is_an_entry_and_a_wrapper(tmp_path: Path, degrees: str) -> None:
    env = recorder(tmp_path / "data", action_mode=degrees, binary_gripper=True)
    plain = duobench.make(TASK, cameras=False, binary_gripper=True)
    env.reset(seed=0)
    plain.reset(seed=0)
    for step in range(HORIZON):
        *_, info = env.step(wave(step) * FACTORS)
        *_, expected = plain.step(wave(step))
        np.testing.assert_allclose(info["sent"], expected["sent"], atol=1e-12)
    env.close()
    plain.close()

    data = DataSet.open(tmp_path / "data")
    (recording,) = data.recordings()
    assert (recording.info.action_mode, recording.info.action_names) == (degrees, DEGREES.names)
    np.testing.assert_array_equal(recording.action[5], wave(5) * FACTORS)
    assert find_problems(data) == []

    export_lerobot(data, tmp_path / "export", ExportOptions(cameras=()), workers=0)
    (path,) = (tmp_path / "export" / "data").rglob("*.parquet")
    actions = np.array(pq.read_table(path)["action"].to_pylist(), dtype=np.float32)
    np.testing.assert_array_equal(actions, recording.sent.astype(np.float32))
    given = ExportOptions(cameras=(), action_source=ActionSource.GIVEN)
    with pytest.raises(DataError, match=f"'{degrees}' name no targets"):
        export_lerobot(data, tmp_path / "given", given, workers=0)


def test_a_further_mode_can_be_served(degrees: str) -> None:
    layout = MessageFormat(actions=ActionFormat(mode=degrees))
    assert layout.action_sizes["left_arm"] == action_spec(layout)["left_arm"]["dims"] == 7
    with pytest.raises(UnknownNameError, match="Did you mean 'joint_degrees'"):
        ActionFormat(mode="joint_degree")


def test_a_recording_of_a_mode_that_is_not_here_says_so(tmp_path: Path, degrees: str) -> None:
    recording = recorded(tmp_path, steps=1, action_mode=degrees)
    with pytest.MonkeyPatch.context() as patch:
        table = {name: mode for name, mode in action_modes.ACTION_MODES.items() if name != degrees}
        patch.setattr(action_modes, "ACTION_MODES", table)
        with pytest.raises(UnknownNameError, match="action mode 'joint_degrees'"):
            _ = recording.info.mode


def test_the_mode_is_found_through_wrappers_that_are_not_ours(tmp_path: Path) -> None:
    inner = duobench.make(TASK, cameras=False, action_mode="cartesian")
    env = Recorder(gym.wrappers.RecordEpisodeStatistics(gym.Wrapper(inner)), tmp_path)
    env.reset(seed=0)
    env.close()
    (recording,) = DataSet(tmp_path).recordings()
    assert recording.info.action_mode == "cartesian"
