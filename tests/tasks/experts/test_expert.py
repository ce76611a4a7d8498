"""A task names its expert's script, however the task was asked for."""

from dataclasses import replace
from pathlib import Path

import pytest

import duobench
from duobench.envs import sim_of
from duobench.evaluation import ExpertPolicy
from duobench.tasks import catalog
from duobench.tasks.experts.expert import find_script
from duobench.tasks.experts.scripts import bin_sort
from duobench.world.robot.frames import robot_with
from tests.task_harness import TaskHarness

MODULE = """
from dataclasses import replace
from duobench.tasks.experts.scripts.bin_sort import script as ours
from duobench.tasks import get

def script(arms):
    yield from ours(arms)

TASK = replace(get("bin_sort"), id="my_sort", expert="sorting_by_script:script")
"""


@pytest.mark.parametrize("give", ["object", "path"])
def test_a_task_of_ones_own_names_its_expert(
    give: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sorting_by_script.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    path = "sorting_by_script:TASK"
    task = catalog.get(path)
    assert find_script(task).__module__ == "sorting_by_script"
    env = duobench.make(task if give == "object" else path, cameras=False)
    observation, info = env.reset(seed=0)
    expert = ExpertPolicy(env)
    expert.reset(info["instruction"], seed=0)
    assert env.action_space.contains(expert.act(observation)[0].astype("float32"))
    assert sim_of(env).definition is task


def test_a_changed_task_keeps_its_expert() -> None:
    assert find_script(replace(catalog.get("bin_sort"), horizon=5)) is bin_sort.script


@pytest.mark.parametrize("name", ["join_blocks", "transfer_reorient"])
def test_a_shorter_and_weaker_hand_does_it_too(name: str) -> None:
    task = catalog.get(name)
    bench = TaskHarness(task, robot_with("franka_hand"))
    assert bench.run_for(find_script(task), task.horizon) == task.max_stage
