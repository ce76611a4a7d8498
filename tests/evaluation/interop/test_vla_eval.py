"""vla-eval 0.8 itself, both ways: its model servers as our policies, our tasks in its programs."""

import json
import os
import sqlite3
import subprocess
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

import duobench
from duobench.core.randomness import episode_seed
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.runners.evaluate import evaluate
from duobench.policy.serving.address import RemoteServer
from duobench.results.folder import RunFolder
from duobench.results.scores import Results
from duobench.results.suite import Suite, find_tasks
from tests.docs.markdown import blocks, page_of, table
from tests.evaluation import toy_tasks
from tests.evaluation.interop.conftest import VLA_EVAL_PYTHON, environment
from tests.evaluation.processes import wait_until

PEER = Path(__file__).with_name("vla_eval_peer.py")
BENCHMARK_PEER = Path(__file__).with_name("vla_eval_benchmark_peer.py")
PAGE = page_of("serving")
LENGTH = 6
EPISODES = 2


@contextmanager
def model_server(folder: Path, kind: str) -> Iterator[str]:
    """A model server of vla-eval; its address."""
    path = folder / f"port-{kind}"
    command = [os.environ[VLA_EVAL_PYTHON], str(PEER), str(path), kind, str(LENGTH)]
    with subprocess.Popen(command, env=environment()) as process:
        try:
            wait_until(path.exists, "a model server")
            yield f"ws://127.0.0.1:{path.read_text()}"
        finally:
            process.kill()


@pytest.fixture(params=["whole", "kept"])
def server(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[str]:
    with model_server(tmp_path, request.param) as url:
        yield url


def played_by_us(folder: Path, url: str, workers: int = 0) -> Results:
    choice = PolicyChoice.parse("vla-eval", server=RemoteServer(url=url))
    suite = Suite(tasks=find_tasks([toy_tasks.WAVE_NAME, toy_tasks.NOD_NAME]), episodes=EPISODES)
    return evaluate(choice, suite, RunFolder(folder), workers=workers, videos=0)


def played_by_them(folder: Path, url: str, *options: str) -> list[dict[str, Any]]:
    """The rows of `vla-eval run` with the configuration of the page."""
    (text,) = (block for block in blocks(PAGE, "yaml") if "duobench.evaluation.interop" in block)
    config = folder / "config.yaml"
    config.write_text(text)
    program = Path(os.environ[VLA_EVAL_PYTHON]).absolute().with_name("vla-eval")
    command = [program, "run", "--no-docker", "--config", config, "--server-url", url]
    command += ["--output-dir", folder, "--yes", *options]
    done = subprocess.run(
        command, env=environment(), check=False, capture_output=True, text=True, cwd=folder
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Spec mismatch" not in done.stdout + done.stderr
    (recording,) = folder.glob("recording-*.sqlite")
    with closing(sqlite3.connect(recording)) as base:
        base.row_factory = sqlite3.Row
        rows = [dict(row) for row in base.execute("SELECT * FROM episode_results")]
    return [row | {"metrics": json.loads(row["metrics"])} for row in rows]


def test_its_model_server_is_a_policy_of_ours(tmp_path: Path, server: str) -> None:
    results = played_by_us(tmp_path / "run", server, workers=2)
    records = [record for task in results.tasks for record in task.records]
    assert [record.error for record in records] == [None] * 2 * EPISODES
    assert {record.success for record in records} == {True, False}
    assert "LiftsServer" in (records[0].policy_version or "")
    assert records[0].first_answer is not None


def test_our_tasks_in_its_program_have_the_results_of_our_evaluation(
    tmp_path: Path, server: str
) -> None:
    tasks = f"task_ids=[{toy_tasks.WAVE_NAME},{toy_tasks.NOD_NAME}]"
    options = ["--param", tasks, "--benchmark-field", f"episodes_per_task={EPISODES}"]
    rows = played_by_them(tmp_path, server, *options)
    results = played_by_us(tmp_path / "run", server)
    ours = {}
    for record in (record for task in results.tasks for record in task.records):
        outcome = {"success": record.success, "progress": record.progress}
        ours[record.task, record.episode] = {**outcome, "stage": record.final_stage}
    assert {(row["task_name"], row["episode_id"]): row["metrics"] for row in rows} == ours


def test_benchmark_is_what_its_programs_expect() -> None:
    command = [os.environ[VLA_EVAL_PYTHON], str(BENCHMARK_PEER)]
    told = json.loads(
        subprocess.run(command, check=True, capture_output=True, env=environment()).stdout
    )
    env = duobench.make("bin_sort", cameras=False)
    observation, _ = env.reset(seed=episode_seed("bin_sort", 2))  # 1 + 1
    env.close()
    missing, short = told.pop("errors")
    assert "answers without 'actions'" in missing
    assert "(H, 16)" in short
    assert "LIBGL_ALWAYS_SOFTWARE" in told.pop("cpu")
    sizes = [("left_joints", 7), ("right_joints", 7), ("left_gripper", 1), ("right_gripper", 1)]
    assert list(told["sizes"].items()) == sizes
    nothing_reached = {"success": False, "progress": 0.0, "stage": 0}
    assert told == {
        "parameters": sorted(row["parameter"] for row in table(PAGE, "parameter")),
        "task": {"name": "bin_sort", "task_id": "bin_sort"},
        "metadata": {"max_steps": 3, "action_dim": 16},
        "metrics": {"success": "mean", "progress": "mean"},
        "sizes": dict(sizes),
        "mismatches": [],
        "probe": [16],
        "begun": nothing_reached,
        "state": observation["agent_pos"].tolist(),
        "images": {name: [24, 32, 3] for name in ("head", "left_wrist", "right_wrist")},
        "is_done": True,
        "result": nothing_reached,
        "gpu": {},
    }


def test_configuration_of_the_page_plays_a_task_of_the_benchmark(tmp_path: Path) -> None:
    options = ["--param", "task_ids=[bin_sort]", "--param", "max_steps=12"]
    with model_server(tmp_path, "whole") as url:
        field = ["--benchmark-field", "episodes_per_task=1"]
        (row,) = played_by_them(tmp_path, url, *options, *field)
    assert row["status"] == "fail"
    assert row["steps"] == 12 / LENGTH  # calls, each of which is a chunk
    assert row["metrics"]["success"] is False
    assert (row["task_name"], row["failure_reason"]) == ("bin_sort", None)
