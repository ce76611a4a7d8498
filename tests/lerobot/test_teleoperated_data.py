"""A policy is trained on what a scripted operator recorded through the page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from lerobot.datasets import LeRobotDataset

from duobench.cli import main
from duobench.data import DataSet, find_problems
from duobench.policy import make
from tests.lerobot.tools import TINY
from tests.teleop.paging import OPERATOR, record

TASKS = ("bin_sort", "carry_pot")
EPISODES = 2


def test_act_learns_from_a_scripted_operators_episodes(tmp_path: Path) -> None:
    data = DataSet.open(tmp_path / "demos")
    for task in TASKS:
        record(task, data, EPISODES)
    assert not find_problems(data)
    assert {recording.info.actor for recording in data.recordings()} == {OPERATOR}
    options = "--per-task --cameras none --object-state --action joint --workers 0 --after-success"
    exports = tmp_path / "exports"
    main(["export", "lerobot", str(data.path), "--out", str(exports), *options.split()])
    for task in TASKS:
        columns = LeRobotDataset(f"local/{task}", root=exports / task)
        recorded = np.concatenate([each.sent for each in data.recordings(task)])
        actions = [columns[row]["action"].numpy() for row in range(len(columns))]
        assert columns.num_episodes == EPISODES
        np.testing.assert_array_equal(actions, recorded.astype("f4"))
    out = tmp_path / "act"
    words = ["--data", str(exports), "--out", str(out), "--tasks", *TASKS, "--steps", "3"]
    main(["train", "act", *words, "--", *TINY])
    for task in TASKS:
        last = out / task / "checkpoints/last/pretrained_model"
        metadata = make(f"lerobot:{last}?device=cpu").metadata
        assert (metadata.cameras, metadata.object_state) == ((), True)
        assert metadata.action_mode == "joint"
