"""What an export's state holds beside joints and openings."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import duobench
from duobench.cli import main
from duobench.core.errors import OtherRunError
from duobench.data import DataSet
from duobench.data.lerobot.export import export_lerobot
from duobench.data.lerobot.folder import ExportFolder
from duobench.data.lerobot.options import ExportOptions, Pairing
from duobench.envs import state_labels
from duobench.envs.spaces import JOINT_NAMES
from duobench.envs.state_labels import StatePart
from tests.data.tools import HORIZON, TASK

TOOLS, SPEEDS = StatePart.TCP_POSE, StatePart.JOINT_VELOCITY


def exported(data: DataSet, out: Path, **options: Any) -> tuple[dict[str, Any], np.ndarray]:
    """The description of the state, and the rows (T, n) of the first episode."""
    export_lerobot(data, out, ExportOptions(cameras=(), **options), workers=0)
    rows = pq.read_table(ExportFolder(out).data(0))["observation.state"].to_pylist()
    info = json.loads((out / "meta/info.json").read_text())
    return info["features"]["observation.state"], np.array(rows)


@pytest.mark.parametrize("pairing", Pairing)
@pytest.mark.parametrize("parts", [(), (TOOLS,), (SPEEDS,), (SPEEDS, TOOLS, SPEEDS)])
def test_a_state_holds_what_was_recorded_in_the_order_of_its_names(
    original: DataSet, tmp_path: Path, parts: tuple[StatePart, ...], pairing: Pairing
) -> None:
    about, rows = exported(original, tmp_path / "out", state=parts, pairing=pairing)
    recording = next(original.recordings())
    named = dict(zip(about["names"], rows.T, strict=True))
    assert about["shape"] == [len(named)] == [16 + 14 * len({*parts})]
    seen = slice(pairing.offset, pairing.offset + HORIZON)
    expected = dict(zip(JOINT_NAMES, recording.agent_pos[seen].T, strict=True))
    if TOOLS in parts:
        expected |= {
            "left_x": recording.tcp_pose[seen, 0],
            "right_qw": recording.tcp_pose[seen, 13],
        }
    if SPEEDS in parts:
        speeds = recording.joint_velocity[seen]
        expected |= {"left_joint_7_velocity": speeds[:, 6], "right_joint_1_velocity": speeds[:, 7]}
    for name, values in expected.items():
        np.testing.assert_array_equal(named[name], values, err_msg=name)
    assert state_labels.find(about["names"]) == tuple(part for part in StatePart if part in parts)


def test_an_environment_shows_the_tool_poses_that_were_exported(
    original: DataSet, tmp_path: Path
) -> None:
    _, rows = exported(original, tmp_path / "out", state=(TOOLS,))
    env = duobench.make(TASK, cameras=False)
    for index, recording in enumerate(original.recordings()):
        observation, _ = env.reset(seed=index, options={"layout": recording.info.layout})
        shown = state_labels.shown(observation, (TOOLS,))
        path = ExportFolder(tmp_path / "out").data(index)
        row = pq.read_table(path)["observation.state"][0].as_py()
        np.testing.assert_array_equal(np.array(row, np.float32), shown)
    env.close()
    assert not np.array_equal(rows[0], rows[-1])


def test_the_order_of_the_parts_makes_no_other_export(original: DataSet, tmp_path: Path) -> None:
    out, options = tmp_path / "out", ExportOptions(cameras=(), state=(SPEEDS, TOOLS))
    export_lerobot(original, out, options, workers=0)
    words = ["--cameras", "none", "--state", "tcp_pose", "joint_velocity", "--workers", "0"]
    main(["export", "lerobot", str(original.path), "--out", str(out), *words])
    with pytest.raises(OtherRunError, match="state tcp_pose instead of tcp_pose joint_vel"):
        export_lerobot(original, out, replace(options, state=(TOOLS,)), workers=0)
    with pytest.raises(OtherRunError, match="state none instead of tcp_pose joint_velocity"):
        export_lerobot(original, out, replace(options, state=()), workers=0)


def test_both_domains_have_every_part(original: DataSet, real: DataSet, tmp_path: Path) -> None:
    options = ExportOptions(cameras=(), state=tuple(StatePart))
    export_lerobot([real, original], tmp_path / "out", options, workers=0)
    for index, recording in enumerate([*real.recordings(), *original.recordings()]):
        rows = pq.read_table(ExportFolder(tmp_path / "out").data(index))["observation.state"]
        seen = np.hstack([recording.agent_pos, recording.tcp_pose, recording.joint_velocity])
        np.testing.assert_array_equal(np.array(rows.to_pylist(), np.float32), seen[:-1])


def test_other_names_are_no_state() -> None:
    both = state_labels.names_of((TOOLS, SPEEDS))
    assert len({*both}) == len(both) == 44
    for names in ((), both[1:], both[::-1], (*both, "more"), both[16:]):
        assert state_labels.find(names) is None
