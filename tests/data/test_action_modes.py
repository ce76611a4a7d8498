"""What a recording says of its actions in a mode that is added to the table: targets in degrees."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pyarrow.parquet as pq
import pytest

import duobench
from duobench.core.backend import DuoLimits
from duobench.core.errors import DataError, UnknownNameError
from duobench.core.types import FLAT_SIZE, OPENING_SLOTS, Array
from duobench.data import ActionSource, DataSet, ExportOptions, export_lerobot, find_problems
from duobench.envs import DuoWrapper, action_modes, spaces
from duobench.envs.action_modes import ActionMode
from duobench.envs.duo_env import Transition
from duobench.policy.serving.message_format import ActionFormat, MessageFormat
from duobench.policy.serving.vla_eval import action_spec
from tests.data.tools import HORIZON, TASK, recorder
from tests.envs.tools import wave

FACTORS = np.full(FLAT_SIZE, 180 / np.pi)
FACTORS[list(OPENING_SLOTS)] = 1.0


def _space(limits: DuoLimits) -> gym.spaces.Box:
    return spaces.box(limits.low * FACTORS, limits.high * FACTORS)


DEGREES = ActionMode(
    name="joint_degrees",
    names=tuple(f"{name}_degrees" for name in spaces.JOINT_NAMES),
    space=_space,
    wrappers=("tests.data.test_action_modes:DegreeActions",),
)


class DegreeActions(DuoWrapper):
    """Takes joint targets in degrees."""

    action_mode = DEGREES.name

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        self.action_space = DEGREES.space(self.base.backend.limits)

    def check_action(self, action: Any) -> Array:
        return spaces.checked_action(action, DEGREES.names)

    def step(self, action: Any) -> Transition:
        return self.env.step(self.check_action(action) / FACTORS)


@pytest.fixture
def degrees(monkeypatch: pytest.MonkeyPatch) -> str:
    """The mode of degrees, in the table for as long as a test runs."""
    table = {**action_modes.ACTION_MODES, DEGREES.name: DEGREES}
    monkeypatch.setattr(action_modes, "ACTION_MODES", table)
    return DEGREES.name


def test_a_further_mode_is_an_entry_and_a_wrapper(
    tmp_path: Path, degrees: str, monkeypatch: pytest.MonkeyPatch
) -> None:
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

    monkeypatch.delitem(action_modes.ACTION_MODES, degrees)  # pyright: ignore
    with pytest.raises(UnknownNameError, match="action mode 'joint_degrees'"):
        _ = recording.info.mode


def test_a_further_mode_can_be_served(degrees: str) -> None:
    layout = MessageFormat(actions=ActionFormat(mode=degrees))
    assert layout.action_sizes["left_arm"] == action_spec(layout)["left_arm"]["dims"] == 7
    with pytest.raises(UnknownNameError, match="Did you mean 'joint_degrees'"):
        ActionFormat(mode="joint_degree")
